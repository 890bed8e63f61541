// Plots: lines over samples or time, bars of stance; the pointer tells values, a click into a plot over time moves the view.
const D = JSON.parse(document.getElementById("data").textContent);
const byId = id => document.getElementById(id);
const esc = text => String(text).replace(/[&<>"']/g, c => `&#${c.charCodeAt(0)};`);
const known = x => x !== null && x !== undefined && Number.isFinite(x);
const colour = k => `var(--c${k % 8})`;
const dash = k => ["", "6 3", "2 3"][Math.floor(k / 8) % 3];
// Told of each moment that the view shows [s].
let followers = [], moment = null;
let showMoment = () => {};

function follow(time) {
  moment = time;
  followers = followers.filter(one => one(time));
}

function told(x) {
  if (!known(x)) return "–";
  const size = Math.abs(x);
  if (size !== 0 && size < 1e-3) return x.toExponential(1);
  return x.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}

// Round numbers within a range.
function ticks([low, high], most) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= raw * 0.999) || 10 * power;
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step && out.length < 20; k++) out.push(k * step);
  return { at: out, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// Round numbers of ten on an axis of logarithms: 1, 2, 5 where there is room.
function logTicks([low, high]) {
  const out = [], parts = high - low > 2.5 ? [1] : [1, 2, 5];
  for (let k = Math.floor(low); k <= high; k++) for (const m of parts) {
    const y = k + Math.log10(m);
    if (y >= low && y <= high) out.push([y, m * 10 ** k]);
  }
  return out;
}

function nearest(xs, x) {
  let [low, high] = [0, xs.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (xs[middle] > x) high = middle; else low = middle;
  }
  return Math.abs(xs[high] - x) < Math.abs(xs[low] - x) ? high : low;
}

function extent(lists, padded) {
  let low = Infinity, high = -Infinity;
  for (const list of lists) for (const x of list) if (known(x)) { low = Math.min(low, x); high = Math.max(high, x); }
  if (low > high) return [0, 1];
  const pad = padded ? 0.05 * (high - low) || 0.05 * Math.abs(high) || 1 : 0;
  return high - low + 2 * pad > 0 ? [low - pad, high + pad] : [low - 0.5, high + 0.5];
}

// `o`: title, unit, xLabel, lines [{name, x, y, dots}], rows [{name, x, on}] instead of lines, log, zero, wide, toggle, overTime.
function plot(host, o) {
  const box = document.createElement("div");
  box.className = o.wide ? "plot wide" : "plot";
  box.innerHTML = `<h3>${esc(o.title)} <span class="soft">${o.unit ? `[${esc(o.unit)}]` : ""}</span> <span class="soft at"></span></h3>
    <div class="names"></div><div class="drawing"></div>`;
  host.append(box);
  const [at, names, drawing] = [".at", ".names", ".drawing"].map(c => box.querySelector(c));
  const all = o.lines || o.rows, out = new Set();
  const [left, right, top, bottom] = [o.rows ? 76 : 46, 10, 6, 32];
  let svg = null, scales = null;

  names.innerHTML = all.map((one, k) => {
    const mark = `<i style="background:${one.colour || colour(k)}"></i>${esc(one.name)}`;
    return o.toggle ? `<button type="button" data-k="${k}">${mark} <b></b></button>` : `<span>${mark} <b></b></span>`;
  }).join("");
  names.querySelectorAll("button").forEach(button => button.onclick = () => {
    const k = Number(button.dataset.k);
    if (!out.delete(k)) out.add(k);
    button.classList.toggle("out", out.has(k));
    draw();
  });

  function draw() {
    const width = Math.max(260, drawing.clientWidth), height = o.rows ? 34 + 26 * all.length : o.wide ? 240 : 190;
    const shown = all.filter((_, k) => !out.has(k));
    const xs = extent(shown.map(l => l.x), false);
    const level = y => o.log ? (y > 0 ? Math.log10(y) : null) : y;
    const ys = o.rows ? [0, all.length] : extent(shown.map(l => l.y.map(level)), true);
    if (o.zero && ys[0] > 0) ys[0] = 0;
    if (o.zero && ys[0] < 0 && Math.min(...shown.flatMap(l => l.y.filter(known))) >= 0) ys[0] = 0;
    const px = x => left + (x - xs[0]) / (xs[1] - xs[0]) * (width - left - right);
    const py = y => top + (ys[1] - y) / (ys[1] - ys[0]) * (height - top - bottom);
    const floor = height - bottom;
    scales = { px, xs, width, floor };
    let text = "";
    const across = ticks(xs, Math.max(2, Math.min(10, width / 80)));
    for (const x of across.at) {
      text += `<path class="grid" d="M${px(x).toFixed(1)} ${top}V${floor}"/><text x="${px(x).toFixed(1)}" y="${floor + 14}" text-anchor="middle">${x.toFixed(across.digits)}</text>`;
    }
    if (!o.rows) {
      const up = ticks(ys, 5);
      const marks = o.log ? logTicks(ys).map(([y, value]) => [y, told(value)]) : up.at.map(y => [y, y.toFixed(up.digits)]);
      for (const [y, name] of marks) {
        text += `<path class="grid" d="M${left} ${py(y).toFixed(1)}H${width - right}"/><text x="${left - 5}" y="${(py(y) + 4).toFixed(1)}" text-anchor="end">${name}</text>`;
      }
    }
    text += `<text x="${(left + width - right) / 2}" y="${height - 4}" text-anchor="middle">${esc(o.xLabel)}</text>`;
    all.forEach((one, k) => {
      if (out.has(k)) return;
      const paint = one.colour || colour(k);
      text += o.rows ? bars(one, k, paint, px, py) : curve(one, k, paint, px, y => py(level(y)));
    });
    text += `<path class="cross" d=""/><path class="moment" d=""/>`;
    drawing.innerHTML = `<svg viewBox="0 0 ${width} ${height}" role="img" aria-label="${esc(o.title)} over ${esc(o.xLabel)}">${text}</svg>`;
    svg = drawing.firstChild;
    svg.onpointermove = event => point(whereX(event));
    svg.onpointerleave = () => point(null);
    if (o.overTime) {
      svg.onclick = event => showMoment(whereX(event));
      line(".moment", moment);
    }
  }

  function bars(one, k, paint, px, py) {
    let text = `<text x="${left - 5}" y="${(py(all.length - k - 0.5) + 4).toFixed(1)}" text-anchor="end">${esc(one.name.slice(0, 11))}</text>`;
    const step = one.x.length > 1 ? one.x[1] - one.x[0] : 1;
    for (let i = 0; i < one.on.length; i++) {
      const from = i;
      while (i < one.on.length && one.on[i] === one.on[from]) i++;
      if (one.on[from]) {
        const [a, b] = [px(Math.max(one.x[from] - step, one.x[0])), px(one.x[i - 1])];
        text += `<rect x="${a.toFixed(1)}" y="${(py(all.length - k) + 3).toFixed(1)}" width="${Math.max(0.5, b - a).toFixed(1)}" height="20" fill="${paint}"/>`;
      }
      i--;
    }
    return text;
  }

  function curve(one, k, paint, px, py) {
    let d = "", up = true, dots = "";
    one.y.forEach((y, i) => {
      if (!known(y) || (o.log && y <= 0)) { up = true; return; }
      const [a, b] = [px(one.x[i]).toFixed(1), py(y).toFixed(1)];
      d += `${up ? "M" : "L"}${a} ${b}`;
      up = false;
      if (one.dots) dots += `<circle cx="${a}" cy="${b}" r="2.4" style="fill:${paint}"/>`;
    });
    return `<path class="curve" style="stroke:${paint}" stroke-dasharray="${dash(k)}" d="${d}"/>${dots}`;
  }

  function whereX(event) {
    const frame = svg.getBoundingClientRect();
    const x = (event.clientX - frame.left) / frame.width * scales.width;
    return scales.xs[0] + (x - left) / (scales.width - left - right) * (scales.xs[1] - scales.xs[0]);
  }

  function line(name, x) {
    const there = x !== null && x >= scales.xs[0] - 1e-9 && x <= scales.xs[1] + 1e-9;
    svg.querySelector(name).setAttribute("d", there ? `M${scales.px(x).toFixed(1)} ${top}V${scales.floor}` : "");
  }

  function point(x) {
    line(".cross", x);
    at.textContent = x === null ? "" : `${o.xLabel.split(" [")[0]} ${told(Math.max(scales.xs[0], Math.min(scales.xs[1], x)))}`;
    names.querySelectorAll("b").forEach((b, k) => {
      const one = all[k];
      if (x === null || !one.x.length) { b.textContent = ""; return; }
      const i = nearest(one.x, x);
      b.textContent = o.rows ? (one.on[i] ? "down" : "up") : told(one.y[i]);
    });
  }

  draw();
  let seen = drawing.clientWidth;
  new ResizeObserver(() => {
    if (drawing.clientWidth !== seen) { seen = drawing.clientWidth; draw(); }
  }).observe(drawing);
  // A plot that is gone follows no more.
  if (o.overTime) followers.push(time => svg.isConnected && (line(".moment", time), true));
}

const TIMES = Array.from({ length: D.steps }, (_, k) => (k + 1) / D.rate);

function overTime(host, title, unit, series, more) {
  plot(host, { title, unit, xLabel: "time [s]", overTime: true, lines: series.map(([name, y, paint]) => ({ name, x: TIMES, y, colour: paint })), ...more });
}

function learning(host) {
  const L = D.learning, S = L.score, x = "samples [millions]";
  const train = (name, y, k) => ({ name, x: L.samples, y, colour: colour(k) });
  const scored = (name, y) => ({ name, x: S.samples, y, colour: colour(1), dots: true });
  const one = (title, unit, lines, more) => plot(host, { title, unit, xLabel: x, lines, ...more });
  one("Reward of a step", "", [train("training", L.reward, 0)]);
  one("Velocity error", "m/s", [train("training", L.velocity, 0), scored("score", S.velocity)], { zero: true });
  one("Turning error", "rad/s", [train("training", L.turning, 0), scored("score", S.turning)], { zero: true });
  one("Share that fell", "", [train("episodes of training", L.failed, 0), scored("robots of the score", S.fell)], { zero: true });
  one("Standard deviation of actions", "", [train("mean", L.std, 0)], { zero: true });
  one("Learning rate", "", [train("end of the iteration", L.rate, 0)], { log: true });
  const terms = Object.entries(L.terms).map(([name, y]) => ({ name, x: L.samples, y }));
  one("Terms of the reward", "1/s", terms, { wide: true, toggle: true });
}

function joint() {
  const select = byId("joint"), host = byId("joints");
  select.innerHTML = D.joints.map((name, k) => `<option value="${k}">${esc(name)}`).join("");
  select.onchange = () => {
    const k = Number(select.value), limit = D.efforts[k];
    host.innerHTML = "";
    overTime(host, "Angle and its target", `rad; limits ${told(D.lower[k])} to ${told(D.upper[k])}`, [["target", D.targets[k], colour(1)], ["angle", D.angles[k], colour(0)]], { wide: true });
    overTime(host, "Torque", known(limit) ? `N m; limit ±${told(limit)}` : "N m", [["torque", D.torques[k]]], { wide: true });
  };
  select.onchange();
}

if (byId("learning")) learning(byId("learning"));
if (byId("tracking")) {
  const names = [["Forwards", "m/s"], ["To the left", "m/s"], ["Turning to the left", "rad/s"]];
  names.forEach(([title, unit], k) => overTime(byId("tracking"), title, unit, [["commanded", D.commands[k], colour(1)], ["done", D.done[k], colour(0)]], { wide: k === 2 }));
  const feet = byId("feet"), rows = D.feet.map((name, k) => ({ name, x: TIMES, on: D.forces[k].map(f => f > 0) }));
  plot(feet, { title: "Gait: feet on the ground", unit: "", xLabel: "time [s]", overTime: true, wide: true, rows });
  overTime(feet, "Height of the feet over the ground", "cm", D.feet.map((name, k) => [name, D.heights[k].map(h => known(h) ? 100 * h : null)]), { wide: true });
  overTime(feet, "Vertical force on the feet", "N", D.feet.map((name, k) => [name, D.forces[k]]), { wide: true });
  joint();
}
