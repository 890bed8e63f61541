// The walk: a stick figure on its ground, turned with the pointer, played at any speed. The plots over time follow it, and a click
// into one of them moves it.
(function () {
  const byId = id => document.getElementById(id), known = x => x !== null && Number.isFinite(x);
  const canvas = byId("view");
  if (!canvas) return;
  const D = JSON.parse(byId("data").textContent);
  const draw2d = canvas.getContext("2d"), last = D.steps - 1;
  const [play, slider, speed, now] = ["play", "time", "speed", "now"].map(byId);
  slider.max = last;
  let at = 0, playing = !matchMedia("(prefers-reduced-motion: reduce)").matches, turn = -1.05, tilt = 0.3, before = null, paint = {};

  const point = (list, k) => [list[3 * k] / 1e3, list[3 * k + 1] / 1e3, list[3 * k + 2] / 1e3];
  const points = list => Array.from({ length: list.length / 3 }, (_, k) => point(list, k));
  const plus = (a, b, s) => a.map((x, k) => x + s * b[k]);
  const length = a => Math.hypot(...a);
  const finite = list => list.every(known);
  // Size of the robot: farthest link or foot from the base in the first pose.
  const base0 = D.base[0].slice(0, 3);
  const size = Math.max(0.05, ...points(D.links[0]).concat(points(D.feetAt[0])).map(p => length(plus(p, base0, -1))).filter(Number.isFinite));
  // The camera follows the base without its sway: the mean over a second.
  const half = Math.round(D.rate / 2);
  const followed = D.base.map((_, k) => {
    const near = D.base.slice(Math.max(0, k - half), k + half + 1).filter(finite);
    return [0, 1, 2].map(i => near.length ? near.reduce((sum, b) => sum + b[i], 0) / near.length : 0);
  });
  const hips = D.parents.flatMap((parent, k) => parent === 0 ? [k] : []);
  const limbs = D.parents.flatMap((parent, k) => parent > 0 ? [[parent, k]] : []);
  if (hips.length > 2) {
    const start = points(D.links[0]);
    hips.sort((a, b) => Math.atan2(start[a][1] - base0[1], start[a][0] - base0[0]) - Math.atan2(start[b][1] - base0[1], start[b][0] - base0[0]));
  }

  function colours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "soft", "line", "rec", "sim", "body", "good"]) paint[name] = style.getPropertyValue("--" + name).trim();
  }

  function groundAt(x, y) {
    const G = D.ground;
    if (!G) return 0;
    const [i, j] = [(x - G.origin[0]) / G.spacing, (y - G.origin[1]) / G.spacing].map(Math.round);
    if (i < 0 || j < 0 || i >= G.size[0] || j >= G.size[1]) return null;
    const h = G.heights[j * G.size[0] + i];
    return known(h) ? h / 1e3 : null;
  }

  // Between two decisions all points move on straight lines.
  function mixed(rows) {
    const k = Math.floor(at), f = at - k, a = rows[k], b = rows[Math.min(k + 1, last)];
    return a.map((x, i) => x + f * (b[i] - x));
  }

  function camera(width, height) {
    const centre = mixed(followed);
    centre[2] -= 0.25 * size;
    const [ct, st, ce, se] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
    const far = 5.5 * size, scale = Math.min(height / 2.1, width / 3) / size;
    return p => {
      const d = plus(p, centre, -1);
      const depth = far - (d[0] * ce * ct + d[1] * ce * st + d[2] * se);
      if (!(depth > 0.1 * size)) return null;
      const s = scale * far / depth;
      return [width / 2 + s * (d[1] * ct - d[0] * st), height / 2 - s * (d[2] * ce - d[0] * se * ct - d[1] * se * st), depth];
    };
  }

  function stroke(list, see, look, wide, alpha) {
    draw2d.strokeStyle = look;
    draw2d.lineWidth = wide;
    draw2d.globalAlpha = alpha;
    draw2d.beginPath();
    let up = true;
    for (const p of list) {
      const s = p && finite(p) ? see(p) : null;
      if (s) { if (up) draw2d.moveTo(s[0], s[1]); else draw2d.lineTo(s[0], s[1]); }
      up = !s;
    }
    draw2d.stroke();
    draw2d.globalAlpha = 1;
  }

  function polygon(list, see, fill, edge, alpha) {
    const seen = list.map(p => see(p));
    if (!seen.every(Boolean)) return;
    draw2d.beginPath();
    seen.forEach((s, k) => k ? draw2d.lineTo(s[0], s[1]) : draw2d.moveTo(s[0], s[1]));
    draw2d.closePath();
    draw2d.globalAlpha = alpha;
    draw2d.fillStyle = fill;
    draw2d.fill();
    draw2d.globalAlpha = 1;
    if (edge) { draw2d.strokeStyle = edge; draw2d.lineWidth = 1.2; draw2d.stroke(); }
  }

  // Lines on the ground, fainter with distance.
  function grid(see) {
    const [cx, cy] = mixed(followed), reach = 6 * size;
    const raw = 0.6 * size, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= raw);
    const piece = D.ground ? Math.max(D.ground.spacing, step / 4) : step;
    for (const swap of [false, true]) {
      const [along, across] = swap ? [cy, cx] : [cx, cy];
      for (let a = Math.ceil((across - reach) / step); a * step < across + reach; a++) {
        for (let b = Math.floor((along - reach) / piece); b * piece < along + reach; b++) {
          const ends = [b * piece, (b + 1) * piece].map(u => swap ? [a * step, u] : [u, a * step]);
          const middle = Math.hypot((ends[0][0] + ends[1][0]) / 2 - cx, (ends[0][1] + ends[1][1]) / 2 - cy);
          const alpha = 1 - middle / reach;
          if (alpha > 0) stroke(ends.map(([x, y]) => { const h = groundAt(x, y); return h === null ? null : [x, y, h]; }), see, paint.soft, 1, 0.55 * alpha);
        }
      }
    }
  }

  function onGround(p) {
    const h = groundAt(p[0], p[1]);
    return h === null ? null : [p[0], p[1], h];
  }

  // Commanded velocity from the base on: where half a second of it leads, with its turning.
  function asked(see, base) {
    const k = Math.floor(at), [vx, vy, wz] = D.commands.map(c => c[k]);
    const [w, x, y, z] = base.slice(3);
    let heading = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), p = base.slice(0, 2);
    if (vx === 0 && vy === 0 && wz === 0) return;
    const way = [onGround(p)];
    for (let i = 0; i < 20; i++) {
      const [c, s] = [Math.cos(heading), Math.sin(heading)];
      p = [p[0] + 0.05 * (c * vx - s * vy), p[1] + 0.05 * (s * vx + c * vy)];
      heading += 0.05 * wz;
      way.push(onGround(p));
    }
    stroke(way, see, paint.good, 3, 0.9);
    const tip = [0.35, -0.35].map(side => onGround([p[0] - 0.22 * size * Math.cos(heading + side), p[1] - 0.22 * size * Math.sin(heading + side)]));
    stroke([tip[0], onGround(p), tip[1]], see, paint.good, 3, 0.9);
  }

  function robot(see, base, scale) {
    const links = points(mixed(D.links)), feet = points(mixed(D.feetAt)), k = Math.floor(at);
    const legs = limbs.map(([a, b]) => [links[a], links[b]]).concat(feet.map((p, f) => [links[D.footLinks[f]], p]));
    const [w, x, y, z] = base.slice(3);
    const up = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
    const ahead = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)];
    for (const leg of legs) stroke(leg.map(onGround), see, paint.ink, 4 * scale, 0.13);
    const corners = hips.map(h => links[h]), parts = [];
    const deep = list => { const seen = list.map(p => see(p)); return seen.every(Boolean) ? seen.reduce((sum, s) => sum + s[2], 0) / seen.length : 0; };
    if (corners.length > 2) {
      const shadow = corners.map(onGround);
      if (shadow.every(Boolean)) polygon(shadow, see, paint.ink, null, 0.13);
      const [top, low] = [0.13, -0.06].map(s => corners.map(p => plus(p, up, s * size)));
      const faces = [top, low].concat(corners.map((_, i) => { const n = (i + 1) % corners.length; return [top[i], top[n], low[n], low[i]]; }));
      faces.forEach(face => parts.push([deep(face), () => polygon(face, see, paint.body, paint.ink, 0.9)]));
      const nose = plus(base.slice(0, 3), up, 0.13 * size);
      parts.push([deep(top) - 0.01 * size, () => stroke([nose, plus(nose, ahead, 0.45 * size)], see, paint.ink, 3 * scale, 0.8)]);
    } else {
      corners.forEach(p => parts.push([deep([p]), () => stroke([base.slice(0, 3), p], see, paint.ink, 5 * scale, 1)]));
    }
    legs.forEach(leg => parts.push([deep(leg), () => stroke(leg, see, paint.ink, 5 * scale, 1)]));
    feet.forEach((p, f) => parts.push([deep([p]) - 0.02 * size, () => {
      const s = see(p);
      if (!s) return;
      draw2d.fillStyle = D.down[f][k] ? paint.sim : paint.rec;
      draw2d.beginPath();
      draw2d.arc(s[0], s[1], 6 * scale, 0, 2 * Math.PI);
      draw2d.fill();
    }]));
    parts.sort((a, b) => b[0] - a[0]).forEach(part => part[1]());
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1, [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [width * ratio, height * ratio].map(Math.round);
    }
    draw2d.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw2d.clearRect(0, 0, width, height);
    draw2d.lineCap = draw2d.lineJoin = "round";
    const see = camera(width, height), k = Math.floor(at), base = mixed(D.base);
    if (!finite(base)) return;
    grid(see);
    const way = D.base.map(b => finite(b) ? onGround(b) : null);
    stroke(way.slice(0, k + 1), see, paint.soft, 2.5, 0.9);
    stroke(way.slice(k), see, paint.soft, 1.5, 0.35);
    asked(see, base);
    robot(see, base, Math.max(0.6, Math.min(1.2, height / 380)));
  }

  function tell() {
    const k = Math.floor(at), time = (k + 1) / D.rate;
    slider.value = k;
    const three = lists => lists.map(l => known(l[k]) ? l[k].toFixed(2) : "–").join(", ");
    now.textContent = `${time.toFixed(2)} s  asked ${three(D.commands)}  does ${three(D.done)}${D.fell === k ? "  fell" : ""}`;
    qvPlots.moment("time", time);
  }

  function show(step) {
    at = Math.max(0, Math.min(last, step));
    draw();
    tell();
  }

  function set(running) {
    playing = running;
    play.textContent = running ? "Pause" : "Play";
    before = null;
    if (running) requestAnimationFrame(frame);
  }

  function frame(clock) {
    if (!playing) return;
    if (before !== null) {
      const next = at + Math.min(0.1, (clock - before) / 1e3) * D.rate * Number(speed.value);
      show(next > last ? 0 : next);
    }
    before = clock;
    requestAnimationFrame(frame);
  }

  play.onclick = () => set(!playing);
  slider.oninput = () => { set(false); show(Number(slider.value)); };
  document.addEventListener("qv-moment", event => { set(false); show(Math.round(event.detail * D.rate) - 1); });
  canvas.onpointerdown = event => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = event => {
    if (!event.buttons) return;
    turn -= 0.008 * event.movementX;
    tilt = Math.max(-0.1, Math.min(1.5, tilt + 0.006 * event.movementY));
    draw();
  };
  canvas.onkeydown = event => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === " ") set(!playing);
    else if (by) { set(false); show(Math.round(at) + by); }
    else return;
    event.preventDefault();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colours(); draw(); });
  new ResizeObserver(draw).observe(canvas);
  colours();
  show(0);
  set(playing);
})();
