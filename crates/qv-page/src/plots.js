// Plots from numbers that the page carries: see the crate's first page for what a reader can do with them. The page's own script may
// use `qvPlots.moment(link, x)`, which marks a place on the boards of a link, and the event `qv-moment`, which a click on them gives.
const qvPlots = (() => {
  const GAP = 0 / 0, axes = [], NONE = { n: 0, first: 0, step: 1, bytes: 0 };
  const known = x => Number.isFinite(x);
  const tone = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim() || "#888";
  const [LEFT, RIGHT, TOP, BOTTOM] = [56, 10, 6, 34];

  function element(tag, parent, set = {}) {
    const made = document.createElement(tag);
    Object.assign(made, set);
    parent.append(made);
    return made;
  }

  // The numbers of a packed column; a gap is not finite.
  function unpacked({ n, first, step, bytes, data }) {
    const out = new Float64Array(n), codes = bytes ? atob(data) : "", gap = 256 ** bytes - 1;
    for (let k = 0, at = 0; k < n; k++) {
      let code = bytes ? 0 : k;
      for (let b = 0, unit = 1; b < bytes; b++, unit *= 256) code += unit * codes.charCodeAt(at++);
      out[k] = bytes && code === gap ? GAP : first + code * step;
    }
    return out;
  }

  const decimals = step => Math.max(0, Math.min(12, Math.ceil(-Math.log10(step) - 1e-6)));
  const signed = text => text.replace("-", "−");

  // A number to be read: three to four digits.
  function told(x) {
    if (!known(x)) return "–";
    const size = Math.abs(x);
    if (size !== 0 && (size < 1e-3 || size >= 1e7)) return signed(x.toExponential(2));
    return signed(x.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : size >= 1 ? 3 : 4));
  }

  // Round numbers within a range, as place and text.
  function ticks([low, high], most) {
    const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw)), out = [];
    const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= raw * 0.999) || 10 * power;
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step && out.length < 20; k++) {
      out.push([k * step, signed((k * step || 0).toFixed(Math.min(12, digits)))]);
    }
    return out;
  }

  // The same of logarithms to ten: powers, and 2 and 5 between where there is room.
  function logTicks([low, high]) {
    const out = [], parts = high - low > 3 ? [1] : [1, 2, 5];
    for (let k = Math.floor(low); k <= high; k++) for (const m of parts) {
      const at = k + Math.log10(m);
      if (at >= low && at <= high) out.push([at, String(Number((m * 10 ** k).toPrecision(3)))]);
    }
    return out.length > 1 ? out : ticks([low, high], 4).map(([at]) => [at, String(Number((10 ** at).toPrecision(3)))]);
  }

  // First place in a list that never falls that is not below x.
  function lowest(xs, x) {
    let [low, high] = [0, xs.length];
    while (low < high) { const middle = (low + high) >> 1; if (xs[middle] < x) low = middle + 1; else high = middle; }
    return low;
  }

  // The place nearest to x that has a number close by; -1 where there is none.
  function nearest(xs, x, close) {
    const at = lowest(xs, x), other = at > 0 && (at === xs.length || x - xs[at - 1] < xs[at] - x) ? at - 1 : at;
    const beside = [xs[other] - xs[other - 1], xs[other + 1] - xs[other]].filter(d => d > 0);
    return Math.abs(xs[other] - x) <= Math.max(close, beside.length ? Math.min(...beside) : 0) ? other : -1;
  }

  function extent(pairs) {
    let [low, high] = [Infinity, -Infinity];
    for (const [list, from, to] of pairs) for (let k = from; k < to; k++) {
      if (known(list[k])) { if (list[k] < low) low = list[k]; if (list[k] > high) high = list[k]; }
    }
    return low <= high ? [low, high] : null;
  }

  function save(name, kind, parts) {
    const link = element("a", document.body, { href: URL.createObjectURL(new Blob(parts, { type: kind })), download: name });
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  // What boards of one link share: the part that is shown, all of it, and what moves along.
  function axisOf(link) {
    const there = axes.find(axis => link && axis.link === link);
    if (there) return there;
    const axis = { link, range: null, boards: [] };
    axis.all = () => {
      const [low, high] = extent(axis.boards.map(board => board.extent()).filter(Boolean).map(ends => [ends, 0, 2])) || [0, 1];
      return high > low ? [low, high] : [low - 0.5, high + 0.5];
    };
    axis.shown = () => axis.range || axis.all();
    axis.draw = () => axis.boards.forEach(board => board.draw());
    axis.point = x => axis.boards.forEach(board => board.point(x));
    axis.moment = x => { axis.marked = x; axis.boards.forEach(board => board.mark(x)); };
    axis.go = range => {
      const [low, high] = axis.all(), wide = range ? range[1] - range[0] : 0;
      axis.range = wide > 1e-6 * (high - low) ? range : null;
      axis.draw();
      axis.point(null);
    };
    axes.push(axis);
    return axis;
  }

  function board(host) {
    const B = JSON.parse(host.querySelector("script").textContent), columns = [], lines = new Map(), off = new Set();
    const axis = axisOf(B.link), flat = B.log ? Math.log10 : x => x, round = B.log ? x => 10 ** x : x => x;
    const chosen = B.choices.map(choice => choice.first), word = B.x.split(" [")[0];
    let views = [];
    const packed = k => B.numbers[k] || NONE, column = k => columns[k] ||= unpacked(packed(k));

    // Places and heights of a line, worked out when they are first asked for.
    function points(line) {
      if (!lines.has(line)) {
        const x = column(line.x), y = column(line.y), other = known(line.minus) ? column(line.minus) : null;
        const count = Math.min(x.length, y.length, other ? other.length : Infinity), values = new Float64Array(count);
        for (let k = 0; k < count; k++) values[k] = (other ? y[k] - other[k] : y[k]) * line.factor;
        lines.set(line, { x: B.log ? x.slice(0, count).map(flat) : x.subarray(0, count), y: values });
      }
      return lines.get(line);
    }

    host.textContent = "";
    const tools = element("div", host, { className: "tools" }), place = element("div", host, { className: "panels" });
    B.choices.forEach((choice, k) => {
      const select = element("select", element("label", tools, { textContent: choice.name }));
      choice.options.forEach((name, value) => element("option", select, { value, textContent: name, selected: value === choice.first }));
      select.onchange = () => { chosen[k] = Number(select.value); show(); };
    });
    const stretch = B.stretches.length ? element("select", element("label", tools, { textContent: "stretch" })) : null;
    if (stretch) {
      element("option", stretch, { value: -1, textContent: "all" });
      element("option", stretch, { value: "", textContent: "as zoomed", hidden: true });
      B.stretches.forEach((one, value) => element("option", stretch, { value, textContent: one.name }));
      stretch.onchange = () => axis.go(stretch.value < 0 ? null : B.stretches[stretch.value].x.map(flat));
    }
    const buttons = element("span", tools);
    const button = (textContent, title, onclick) => element("button", buttons, { type: "button", textContent, title, onclick });
    const moves = [button("‹", "the part before", () => step(-1)), button("›", "the part after", () => step(1))];
    const whole = button("whole", "all of it; so does a double click", () => axis.go(null));
    button("PNG", "what is shown as a picture", () => picture());
    button("CSV", "what is shown as a table", () => table());

    function step(by) {
      const [low, high] = axis.shown(), [first, last] = axis.all(), wide = high - low;
      const starts = B.stretches.map(one => flat(one.x[0])), near = 1e-6 * wide;
      const before = starts.filter(x => axis.range && (by > 0 ? x <= low + near : x < low - near)).length;
      const next = B.stretches[by > 0 ? before : axis.range ? before - 1 : starts.length - 1];
      const from = Math.max(first, Math.min(last - wide, low + 0.8 * by * wide));
      if (next || !stretch) axis.go(next ? next.x.map(flat) : [from, from + wide]);
    }

    // Panels of what is chosen.
    function show() {
      place.textContent = "";
      const panels = B.panels.filter(p => (p.when || []).every((options, k) => !options.length || options.includes(chosen[k])));
      views = panels.map(panel => view(panel));
      axis.draw();
      self.mark(axis.marked);
    }

    function view(panel) {
      const box = element("div", place, { className: panel.half ? "panel half" : "panel" });
      const head = element("h3", box, { textContent: panel.title + " " });
      element("span", head, { className: "soft", textContent: panel.unit ? `[${panel.unit}]` : "" });
      const at = element("span", head, { className: "at soft" }), names = element("div", box, { className: "lines" });
      const values = panel.lines.map(line => {
        const name = element("button", names, { className: "line", type: "button", title: "switch off or on" });
        element("i", name).style.background = `var(--${line.tone})`;
        name.append(line.name + " ");
        name.onclick = () => { if (!off.delete(line.name)) off.add(line.name); axis.draw(); };
        return element("b", name);
      });
      const rows = panel.lines.length > 0 && panel.lines.every(line => line.look === "bar");
      const height = rows ? TOP + BOTTOM + 24 * panel.lines.length : panel.half ? 190 : 230;
      const drawing = element("div", box, { className: "drawing", tabIndex: 0 });
      drawing.style.setProperty("--height", height + "px");
      const canvas = element("canvas", drawing);
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${panel.title} over ${B.x}`);
      const [cross, moment, span] = ["cross", "moment", "span"].map(className => element("i", drawing, { className }));
      const one = { panel, box, at, values, rows, height, drawing, canvas, cross, moment, span };
      listen(one);
      new ResizeObserver(() => paintCanvas(one)).observe(drawing);
      return one;
    }

    const inner = drawing => Math.max(20, drawing.clientWidth - LEFT - RIGHT);
    const placeOf = (drawing, x) => { const [a, b] = axis.shown(); return LEFT + (x - a) / (b - a) * inner(drawing); };
    function whereIs(drawing, event) {
      const [a, b] = axis.shown(), share = (event.clientX - drawing.getBoundingClientRect().left - LEFT) / inner(drawing);
      return a + Math.max(0, Math.min(1, share)) * (b - a);
    }

    function listen({ drawing, span }) {
      let start = null, pixel = 0, at = null;
      drawing.onpointerdown = event => {
        if (event.button) return;
        [start, pixel] = [whereIs(drawing, event), event.clientX];
        drawing.setPointerCapture(event.pointerId);
      };
      drawing.onpointermove = event => {
        axis.point(at = whereIs(drawing, event));
        const [a, b] = [start, at].map(x => placeOf(drawing, x)).sort((p, q) => p - q);
        span.style.cssText = start !== null && Math.abs(event.clientX - pixel) > 4 ? `display:block;left:${a}px;width:${b - a}px` : "";
      };
      drawing.onpointerup = event => {
        const end = whereIs(drawing, event), far = Math.abs(event.clientX - pixel);
        if (start !== null && far > 6) axis.go([start, end].sort((p, q) => p - q));
        else if (start !== null && B.tells) document.dispatchEvent(new CustomEvent("qv-moment", { detail: round(end) }));
        start = null;
        span.style.cssText = "";
        axis.point(at = end);
      };
      drawing.onpointercancel = () => { start = null; span.style.cssText = ""; };
      drawing.onpointerleave = event => { if (event.pointerType === "mouse") axis.point(at = null); };
      drawing.ondblclick = () => axis.go(null);
      drawing.onkeydown = event => {
        const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key], [a, b] = axis.shown();
        if (by) axis.point(at = Math.max(a, Math.min(b, (at === null ? (a + b) / 2 : at) + by * (b - a) / 100)));
        else if (event.key === "Escape") axis.go(null);
        else return;
        event.preventDefault();
      };
    }

    // Where lines lie within the part that is shown.
    function within(line) {
      const { x, y } = points(line), [a, b] = axis.shown(), wide = 1e-9 * (b - a);
      return { x, y, from: lowest(x, a - wide), to: lowest(x, b + wide) };
    }

    const isOn = line => !off.has(line.name);

    function heights(panel, rows) {
      if (rows) return [0, panel.lines.length];
      const level = panel.log ? y => y > 0 ? Math.log10(y) : GAP : y => y;
      const pairs = panel.lines.filter(isOn).map(within)
        .map(({ y, from, to }) => from < to ? [y, from, to] : [y, Math.max(0, from - 1), Math.min(y.length, to + 1)])
        .map(([y, from, to]) => panel.log ? [y.slice(from, to).map(level), 0, to - from] : [y, from, to]);
      let [low, high] = extent(pairs) || [0, 1];
      const pad = 0.05 * (high - low) || 0.05 * Math.abs(high) || 1, above = low >= 0;
      [low, high] = [low - pad, high + pad];
      if (panel.zero && !panel.log) [low, high] = [above ? 0 : Math.min(low, 0), Math.max(high, 0)];
      return [low, high];
    }

    // Draws a panel of this size at the origin of a context.
    function paint(c, { panel, rows }, width, height) {
      const [a, b] = axis.shown(), [low, high] = heights(panel, rows), floor = height - BOTTOM;
      const px = x => LEFT + (x - a) / (b - a) * (width - LEFT - RIGHT), py = y => TOP + (high - y) / (high - low) * (floor - TOP);
      const ink = tone("soft"), grid = tone("line");
      c.font = "11.5px system-ui, sans-serif";
      c.lineJoin = "round";
      const rule = (x0, y0, x1, y1) => { c.strokeStyle = grid; c.lineWidth = 1; c.beginPath(); c.moveTo(x0, y0); c.lineTo(x1, y1); c.stroke(); };
      const write = (text, x, y, align) => { c.fillStyle = ink; c.textAlign = align; c.fillText(text, x, y); };
      for (const [x, text] of B.log ? logTicks([a, b]) : ticks([a, b], Math.max(2, Math.min(10, width / 64)))) {
        rule(px(x), TOP, px(x), floor);
        write(text, px(x), floor + 15, "center");
      }
      if (!rows) for (const [y, text] of panel.log ? logTicks([low, high]) : ticks([low, high], Math.max(3, height / 48))) {
        rule(LEFT, py(y), width - RIGHT, py(y));
        write(text, LEFT - 6, py(y) + 4, "right");
      }
      write(B.x, (LEFT + width - RIGHT) / 2, height - 4, "center");
      c.save();
      c.beginPath();
      c.rect(LEFT, TOP, width - LEFT - RIGHT, floor - TOP);
      c.clip();
      for (const band of panel.bands.filter(one => one.x.every(known))) {
        const [from, to] = band.x.map(x => px(flat(x)));
        c.globalAlpha = 0.15;
        c.fillStyle = tone(band.tone);
        c.fillRect(from, TOP, to - from, floor - TOP);
      }
      c.globalAlpha = 1;
      panel.lines.forEach((line, k) => {
        if (!isOn(line)) return;
        if (rows) bars(c, line, px, py(panel.lines.length - k) + 4, a, b);
        else curve(c, line, px, panel.log ? y => py(Math.log10(y)) : py, width, panel.log);
      });
      c.restore();
      if (rows) panel.lines.forEach((line, k) => write(line.name.slice(0, 9), LEFT - 6, py(panel.lines.length - k - 0.5) + 4, "right"));
    }

    function bars(c, line, px, top, a, b) {
      const { x, y } = points(line), on = k => y[k] > 0;
      c.fillStyle = tone(line.tone);
      for (let k = Math.max(0, lowest(x, a) - 1); k < x.length && x[Math.max(0, k - 1)] <= b; k++) {
        // A number holds for the time that ends with it.
        const from = k, left = px(x[Math.max(0, k - 1)]);
        while (k + 1 < x.length && on(k + 1) === on(from)) k++;
        if (on(from)) c.fillRect(left, top, Math.max(0.6, px(x[k]) - left), 16);
      }
    }

    // Of many points the first, least, greatest and last of each pixel are drawn, so that no peak is lost.
    function curve(c, line, px, py, width, log) {
      const { x, y, from, to } = within(line), first = Math.max(0, from - 1), last = Math.min(x.length, to + 1);
      const many = last - first > 4 * width, dots = [];
      let up = true, seen = -1, group = null;
      c.beginPath();
      const put = k => { if (up) c.moveTo(px(x[k]), py(y[k])); else c.lineTo(px(x[k]), py(y[k])); up = false; };
      const flush = () => { if (group) group.sort((a, b) => a - b).forEach(put); group = null; };
      for (let k = first; k < last; k++) {
        if (!known(y[k]) || !known(x[k]) || (log && y[k] <= 0)) { flush(); up = true; continue; }
        if (!many) {
          put(k);
          if (line.look === "dots" || !known(y[k - 1]) && !known(y[k + 1])) dots.push([px(x[k]), py(y[k])]);
          continue;
        }
        const pixel = Math.round(px(x[k]));
        if (pixel !== seen) flush();
        seen = pixel;
        group = group ? [group[0], y[k] < y[group[1]] ? k : group[1], y[k] > y[group[2]] ? k : group[2], k] : [k, k, k, k];
      }
      flush();
      c.strokeStyle = c.fillStyle = tone(line.tone);
      c.lineWidth = line.look === "wide" ? 2.8 : 1.6;
      c.globalAlpha = line.look === "wide" ? 0.55 : 1;
      c.setLineDash(line.look === "dashed" ? [6, 4] : []);
      c.stroke();
      c.setLineDash([]);
      for (const [h, v] of dots) { c.beginPath(); c.arc(h, v, 2.4, 0, 7); c.fill(); }
      c.globalAlpha = 1;
    }

    function paintCanvas(one) {
      const { canvas, drawing } = one, ratio = window.devicePixelRatio || 1, [width, height] = [drawing.clientWidth, one.height];
      if (!width) return;
      [canvas.width, canvas.height] = [width, height].map(size => Math.round(size * ratio));
      const c = canvas.getContext("2d");
      c.scale(ratio, ratio);
      paint(c, one, width, height);
      one.box.querySelectorAll(".line").forEach((name, k) => name.classList.toggle("out", !isOn(one.panel.lines[k])));
      stand(one.moment, drawing, axis.marked);
      one.cross.style.display = "none";
    }

    function stand(mark, drawing, x) {
      const [a, b] = axis.shown(), there = known(x) && x >= a && x <= b;
      mark.style.cssText = there ? `display:block;left:${placeOf(drawing, x)}px` : "";
    }

    // All that is shown, one below the other, on a card.
    function picture() {
      const width = Math.max(...views.map(v => v.drawing.clientWidth)), scale = 2, canvas = document.createElement("canvas");
      const height = views.reduce((sum, v) => sum + v.height + 44, 10);
      [canvas.width, canvas.height] = [scale * (width + 20), scale * height];
      const c = canvas.getContext("2d");
      c.scale(scale, scale);
      c.fillStyle = tone("card");
      c.fillRect(0, 0, width + 20, height);
      c.translate(10, 10);
      for (const one of views) {
        c.font = "600 13px system-ui, sans-serif";
        c.textAlign = "left";
        c.fillStyle = tone("ink");
        c.fillText(whose(one.panel).join(", ") + (one.panel.unit ? ` [${one.panel.unit}]` : ""), 0, 12);
        let at = 0;
        c.font = "12px system-ui, sans-serif";
        for (const line of one.panel.lines.filter(isOn)) {
          c.fillStyle = tone(line.tone);
          c.fillRect(at, 24, 16, 3);
          c.fillText(line.name, at + 20, 29);
          at += 36 + c.measureText(line.name).width;
        }
        c.translate(0, 34);
        paint(c, one, width, one.height);
        c.translate(0, one.height + 10);
      }
      canvas.toBlob(blob => save(file("png"), "image/png", [blob]));
    }

    // Names of what is chosen.
    const about = () => B.choices.map((choice, k) => choice.options[chosen[k]]).filter(Boolean);
    const whose = panel => [...about().filter(name => !panel.title.includes(name)), panel.title];
    const file = ending => [document.title, ...about()].join(" ").replace(/[^\p{L}\p{N}._-]+/gu, "_").slice(0, 90) + "." + ending;

    // All lines that are shown, in the part that is shown; lines of other times get rows of their own.
    function table() {
      const shown = views.flatMap(({ panel }) => panel.lines.filter(isOn).map(line => ({ panel, line }))), rows = new Map();
      shown.forEach(({ line }, k) => {
        const { x, y, from, to } = within(line), digits = decimals(packed(line.y).bytes ? packed(line.y).step * line.factor : 1e-6);
        for (let i = from; i < to; i++) {
          if (!known(y[i]) || !known(x[i])) continue;
          if (!rows.has(x[i])) rows.set(x[i], new Array(shown.length).fill(""));
          rows.get(x[i])[k] = y[i].toFixed(digits);
        }
      });
      const quoted = text => `"${text.replace(/"/g, '""')}"`, step = Math.min(...shown.map(({ line }) => packed(line.x).step));
      const head = shown.map(({ panel, line }) => quoted([...whose(panel), line.name].join(", ") + (panel.unit ? ` [${panel.unit}]` : "")));
      const digits = Math.max(4, Math.min(9, decimals(step) + 1));
      const body = [...rows].sort((p, q) => p[0] - q[0]).map(([x, cells]) => [round(x).toFixed(digits), ...cells].join(","));
      save(file("csv"), "text/csv", [[[quoted(B.x), ...head].join(","), ...body].join("\n") + "\n"]);
    }

    const self = {
      extent: () => extent(views.flatMap(v => v.panel.lines).map(points).map(({ x }) => [x, 0, x.length])),
      draw: () => {
        views.forEach(paintCanvas);
        const at = axis.range ? B.stretches.findIndex(one => one.x.every((x, k) => flat(x) === axis.range[k])) : -1;
        if (stretch) stretch.value = axis.range && at < 0 ? "" : at;
        whole.disabled = !axis.range;
        moves.forEach(move => { move.disabled = !axis.range && !stretch; });
      },
      mark: x => views.forEach(v => stand(v.moment, v.drawing, x)),
      point: x => views.forEach(one => {
        stand(one.cross, one.drawing, x === null ? GAP : x);
        one.at.textContent = x === null ? "" : `${word} ${told(round(x))}`;
        const [a, b] = axis.shown(), close = 4 / inner(one.drawing) * (b - a);
        one.values.forEach((value, k) => {
          const { x: xs, y } = points(one.panel.lines[k]), at = x === null ? -1 : nearest(xs, x, close);
          value.textContent = x === null ? "" : at < 0 ? "–" : one.rows ? (y[at] > 0 ? "on" : "off") : told(y[at]);
        });
      }),
    };
    axis.boards.push(self);
    show();
    if (B.stretches[B.begin]) axis.go(B.stretches[B.begin].x.map(flat));
  }

  document.querySelectorAll(".board").forEach(board);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => axes.forEach(axis => axis.draw()));
  return { moment: (link, x) => axes.filter(axis => axis.link === link).forEach(axis => axis.moment(x)), told };
})();
