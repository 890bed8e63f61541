// Shows what `qv view` put into the page. The world has z up; angles are radians, lengths metres, times seconds.
(() => {
"use strict";
const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);
const TRACKS = { recorded: 0xe8edf2, simulated: 0xd9601a, corrected: 0x1f6fb5 };
const CAUSE = 0xe0263c, LABELS = [0x9aa7b4, 0xc9a26b, 0x7fae7a, 0xb98bb5, 0x8fb8c9, 0xc98b7f, 0xb5b56b, 0xa0a0d0];

// ---- what is packed -------------------------------------------------------------------------------------------------

function bytesOf(base64) {
    const text = atob(base64), bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    return bytes;
}
const floats = (base64) => new Float32Array(bytesOf(base64).buffer);

/** Gaussians of a compressed PLY: for each four texels of four numbers, see `GAUSSIAN`. */
function gaussians(base64, count) {
    const bytes = bytesOf(base64), mark = "end_header\n";
    const head = String.fromCharCode(...bytes.subarray(0, 2048));
    const start = head.indexOf(mark) + mark.length, chunks = Math.ceil(count / 256);
    const view = new DataView(bytes.buffer, start);
    const words = chunks * 72;
    const width = 1024, height = Math.ceil((count * 4) / width);
    const texels = new Float32Array(width * height * 4), places = new Float32Array(count * 3);
    const share = (low, high, s) => low + (high - low) * s;
    for (let k = 0; k < count; k++) {
        const range = (j) => view.getFloat32((k >> 8) * 72 + 4 * j, true);
        const word = (j) => view.getUint32(words + 16 * k + 4 * j, true);
        const three = (w) => [(w >>> 21) / 2047, ((w >>> 11) & 1023) / 1023, (w & 2047) / 2047];
        const at = three(word(0)).map((s, c) => share(range(c), range(c + 3), s));
        const scale = three(word(2)).map((s, c) => Math.exp(share(range(c + 6), range(c + 9), s)));
        const colour = word(3), rgb = [24, 16, 8].map((b, c) => share(range(c + 12), range(c + 15), ((colour >>> b) & 255) / 255));
        const packed = word(1), largest = packed >>> 30, q = [0, 0, 0, 0];
        let sum = 0, shift = 20;
        for (let c = 0; c < 4; c++) {
            if (c === largest) continue;
            q[c] = (((packed >>> shift) & 1023) / 1023 - 0.5) * Math.SQRT2;
            sum += q[c] * q[c];
            shift -= 10;
        }
        q[largest] = Math.sqrt(Math.max(0, 1 - sum));
        const [w, x, y, z] = q;
        const turn = [
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        ];
        const variance = (i, j) => {
            let total = 0;
            for (let c = 0; c < 3; c++) total += turn[3 * i + c] * turn[3 * j + c] * scale[c] * scale[c];
            return total;
        };
        texels.set([...at, (colour & 255) / 255, variance(0, 0), variance(0, 1), variance(0, 2), variance(1, 1),
            variance(1, 2), variance(2, 2), rgb[0], rgb[1], rgb[2], 0, 0, 0], 16 * k);
        places.set(at, 3 * k);
    }
    return { texels, places, width, height };
}

// ---- the scene ------------------------------------------------------------------------------------------------------

let renderer;
try {
    renderer = new THREE.WebGLRenderer({ canvas: $("scene"), antialias: true, preserveDrawingBuffer: true });
} catch (error) {
    $("controls").textContent = "This page needs a browser with WebGL 2: " + error.message;
    $("clock").hidden = true;
    return;
}
const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(55, 1, 0.02, 500);
camera.up.set(0, 0, 1);
scene.background = new THREE.Color(0x20252c);
scene.add(new THREE.AmbientLight(0xffffff, 1.4));
const sun = new THREE.DirectionalLight(0xffffff, 1.8);
sun.position.set(3, -4, 8);
scene.add(sun);
const orbit = new THREE.OrbitControls(camera, renderer.domElement);
let dirty = true, sorted = null;
orbit.addEventListener("change", () => { dirty = true; });
const layers = {};
function layer(name, object, colour) {
    scene.add(object);
    layers[name] = { object, colour };
    return object;
}

// Each Gaussian is projected as Zwicker et al. (2001) do: its covariance through the derivative of the projection, wider by 0.3 px.
// Declared by three.js: position, modelViewMatrix, projectionMatrix.
const GAUSSIAN = {
    vertex: `precision highp float; precision highp sampler2D;
uniform sampler2D texels; uniform vec2 size; uniform vec2 focal;
in float which; out vec2 place; out vec4 colour;
vec4 texel(int k) { int w = textureSize(texels, 0).x; return texelFetch(texels, ivec2(k % w, k / w), 0); }
void main() {
    int k = int(which) * 4; vec4 a = texel(k), b = texel(k + 1), c = texel(k + 2), d = texel(k + 3);
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0); place = vec2(0.0); colour = vec4(c.zw, d.x, a.w);
    vec3 t = (modelViewMatrix * vec4(a.xyz, 1.0)).xyz; float depth = -t.z;
    if (depth < 0.05) return;
    mat3 v = mat3(b.x, b.y, b.z, b.y, b.w, c.x, b.z, c.x, c.y), w = mat3(modelViewMatrix);
    vec2 limit = 0.65 * size / focal; vec2 at = clamp(t.xy / depth, -limit, limit) * depth;
    mat3 j = mat3(focal.x / depth, 0.0, 0.0, 0.0, focal.y / depth, 0.0, focal.x * at.x / (depth * depth), focal.y * at.y / (depth * depth), 0.0);
    mat3 m = j * w; mat3 s = m * v * transpose(m);
    float p = s[0][0] + 0.3, q = s[1][1] + 0.3, r = s[0][1], middle = 0.5 * (p + q), apart = sqrt(max(0.25 * (p - q) * (p - q) + r * r, 1e-9));
    vec2 axis = abs(r) < 1e-6 ? (p >= q ? vec2(1.0, 0.0) : vec2(0.0, 1.0)) : normalize(vec2(r, middle + apart - p));
    float most = min(sqrt(middle + apart), 1024.0), least = min(sqrt(max(middle - apart, 0.1)), 1024.0);
    place = position.xy * 3.0;
    vec2 shift = place.x * most * axis + place.y * least * vec2(-axis.y, axis.x);
    vec4 clip = projectionMatrix * vec4(t, 1.0);
    gl_Position = vec4(clip.xy + 2.0 * shift / size * clip.w, clip.zw);
}`,
    fragment: `precision highp float; in vec2 place; in vec4 colour; out vec4 result; uniform float most;
void main() {
    float alpha = min(0.99, colour.a * exp(-0.5 * dot(place, place))) * most;
    if (alpha < 0.004) discard;
    result = vec4(max(colour.rgb, 0.0) * alpha, alpha);
}`,
};

let splat = null;
if (data.splat && data.splat.count > 0) {
    const count = data.splat.count, { texels, places, width, height } = gaussians(data.splat.file, count);
    const texture = new THREE.DataTexture(texels, width, height, THREE.RGBAFormat, THREE.FloatType);
    texture.needsUpdate = true;
    const shape = new THREE.InstancedBufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), 3));
    shape.setIndex([0, 1, 2, 0, 2, 3]);
    const which = new THREE.InstancedBufferAttribute(new Float32Array(count), 1);
    shape.setAttribute("which", which);
    shape.instanceCount = count;
    const material = new THREE.ShaderMaterial({
        glslVersion: THREE.GLSL3, vertexShader: GAUSSIAN.vertex, fragmentShader: GAUSSIAN.fragment, transparent: true,
        depthWrite: false, blending: THREE.CustomBlending, blendSrc: THREE.OneFactor, blendDst: THREE.OneMinusSrcAlphaFactor,
        uniforms: { texels: { value: texture }, size: { value: new THREE.Vector2() }, focal: { value: new THREE.Vector2() }, most: { value: 1 } },
    });
    const object = new THREE.Mesh(shape, material);
    object.frustumCulled = false;
    object.renderOrder = 10;
    layer("place", object, 0x888888);
    splat = { count, places, which, material, buckets: new Uint32Array(65537), keys: new Uint16Array(count) };
    if (data.splat.background) scene.background.setRGB(...data.splat.background, "srgb");
}

/** Puts Gaussians in order, the farthest first; a view that hardly turned keeps its order. */
function sort() {
    camera.updateMatrixWorld();
    const e = camera.matrixWorldInverse.elements, now = [e[2], e[6], e[10], e[14]];
    if (sorted && Math.hypot(...now.map((x, k) => x - sorted[k])) < 1e-3) return;
    sorted = now;
    const { count, places, which, buckets, keys } = splat;
    let low = Infinity, high = -Infinity;
    const depths = new Float32Array(count);
    for (let k = 0; k < count; k++) {
        const d = now[0] * places[3 * k] + now[1] * places[3 * k + 1] + now[2] * places[3 * k + 2];
        depths[k] = d;
        if (d < low) low = d;
        if (d > high) high = d;
    }
    buckets.fill(0);
    const factor = 65535 / Math.max(high - low, 1e-9);
    for (let k = 0; k < count; k++) buckets[(keys[k] = Math.floor((depths[k] - low) * factor)) + 1]++;
    for (let k = 0; k < 65536; k++) buckets[k + 1] += buckets[k];
    for (let k = 0; k < count; k++) which.array[buckets[keys[k]]++] = k;
    which.needsUpdate = true;
}

const bounds = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
function reach(x, y, z) {
    [x, y, z].forEach((v, c) => { bounds[0][c] = Math.min(bounds[0][c], v); bounds[1][c] = Math.max(bounds[1][c], v); });
}

if (data.mesh) {
    const vertices = floats(data.mesh.vertices), corners = new Uint32Array(bytesOf(data.mesh.triangles).buffer);
    const labels = new Uint16Array(bytesOf(data.mesh.labels).buffer), shape = new THREE.BufferGeometry();
    const at = new Float32Array(corners.length * 3), colours = new Float32Array(corners.length * 3), colour = new THREE.Color();
    for (let k = 0; k < corners.length; k++) {
        const v = corners[k];
        at.set(vertices.subarray(3 * v, 3 * v + 3), 3 * k);
        colour.setHex(LABELS[(labels[Math.floor(k / 3)] || 0) % LABELS.length]);
        colours.set([colour.r, colour.g, colour.b], 3 * k);
        reach(at[3 * k], at[3 * k + 1], at[3 * k + 2]);
    }
    shape.setAttribute("position", new THREE.BufferAttribute(at, 3));
    shape.setAttribute("color", new THREE.BufferAttribute(colours, 3));
    shape.computeVertexNormals();
    layer("ground", new THREE.Mesh(shape, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide })), LABELS[0]);
}

// ---- the robot ------------------------------------------------------------------------------------------------------

const robots = [];
function shapeOf(part) {
    const s = part.size;
    switch (part.kind) {
    case "sphere": return new THREE.SphereGeometry(s[0], 20, 14);
    case "box": return new THREE.BoxGeometry(2 * s[0], 2 * s[1], 2 * s[2]);
    // Along y in three.js, along z in the model.
    case "capsule": return new THREE.CapsuleGeometry(s[0], 2 * s[1], 8, 16).rotateX(Math.PI / 2);
    case "cylinder": return new THREE.CylinderGeometry(s[0], s[0], 2 * s[1], 20).rotateX(Math.PI / 2);
    case "hull": {
        const points = [];
        for (let k = 0; k + 2 < s.length; k += 3) points.push(new THREE.Vector3(s[k], s[k + 1], s[k + 2]));
        return new THREE.ConvexGeometry(points);
    }
    default: {
        const end = new THREE.Vector3(...s), length = end.length();
        const bone = new THREE.CylinderGeometry(0.016, 0.016, Math.max(length, 1e-6), 8).translate(0, length / 2, 0);
        return bone.applyQuaternion(new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), end.normalize()));
    }
    }
}

function robot(track, motion) {
    const poses = floats(track.poses), links = [], all = new THREE.Group(), ghost = track.name !== "recorded";
    for (let k = 0; k < motion.links; k++) {
        const material = new THREE.MeshLambertMaterial({ color: TRACKS[track.name], transparent: ghost, opacity: ghost ? 0.55 : 1 });
        const group = new THREE.Group();
        links.push({ group, material });
        all.add(group);
    }
    for (const part of motion.shapes) {
        const mesh = new THREE.Mesh(shapeOf(part), links[part.link].material);
        if (part.pose) { mesh.position.set(...part.pose.slice(0, 3)); mesh.quaternion.set(...part.pose.slice(3)); }
        links[part.link].group.add(mesh);
    }
    const way = [];
    for (let k = 0; k < poses.length; k += 7 * motion.links) {
        if (!Number.isFinite(poses[k])) continue;
        way.push(new THREE.Vector3(poses[k], poses[k + 1], poses[k + 2]));
        reach(poses[k], poses[k + 1], poses[k + 2]);
    }
    const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(way), new THREE.LineBasicMaterial({ color: TRACKS[track.name] }));
    layer(track.name, all, TRACKS[track.name]);
    layer("path " + track.name, line, TRACKS[track.name]);
    robots.push({ name: track.name, poses, links, all, arrows: track.forces ? arrows(track) : null });
}

/** Arrows that stand on the ground at feet; at the largest force that is usual for its robot one is `LONGEST` m long. */
const LONGEST = 0.25, HEAD = 0.04;
function arrows(track) {
    const all = new THREE.Group(), feet = floats(track.forces.feet), colour = TRACKS[track.name];
    const count = feet.length / (4 * times.length), material = new THREE.MeshLambertMaterial({ color: colour });
    const shaft = new THREE.CylinderGeometry(0.006, 0.006, 1, 10).rotateX(Math.PI / 2).translate(0, 0, 0.5);
    const head = new THREE.CylinderGeometry(0, 0.016, HEAD, 14).rotateX(Math.PI / 2).translate(0, 0, HEAD / 2);
    for (let k = 0; k < count; k++) {
        const arrow = new THREE.Group();
        arrow.add(new THREE.Mesh(shaft, material), new THREE.Mesh(head, material));
        all.add(arrow);
    }
    layer("forces " + track.name, all, colour);
    return { all, feet, scale: LONGEST / track.forces.usual, now: [] };
}

/** Puts the arrows of a robot where they are at an instant. */
function push({ all, feet, scale, now: forces }, instant) {
    all.children.forEach((arrow, foot) => {
        const [x, y, z, force] = feet.subarray(4 * (instant * all.children.length + foot), 4 * (instant * all.children.length + foot) + 4);
        const long = scale * force;
        forces[foot] = Number.isFinite(force) ? force : null;
        arrow.visible = Number.isFinite(x + y + z) && long > 0.002;
        if (!arrow.visible) return;
        const end = Math.min(HEAD, long), [shaft, head] = arrow.children;
        arrow.position.set(x, y, z);
        shaft.scale.z = Math.max(long - end, 1e-6);
        head.position.z = long - end;
        head.scale.setScalar(end / HEAD);
    });
}

const times = data.motion ? floats(data.motion.time) : new Float32Array(0);
if (data.motion) data.motion.tracks.forEach((track) => robot(track, data.motion));

if (data.slips.length) {
    const slips = new THREE.Group();
    data.slips.forEach((slip) => {
        const mark = new THREE.Mesh(new THREE.SphereGeometry(0.012 + Math.min(0.04, slip.distance), 10, 8), new THREE.MeshLambertMaterial({ color: 0xffc21a }));
        mark.position.set(...slip.at);
        mark.userData.time = slip.time;
        slips.add(mark);
    });
    layer("slips", slips, 0xffc21a);
}

// ---- time -----------------------------------------------------------------------------------------------------------

let now = times.length ? times[0] : 0, playing = false, follows = false, last = 0;
/** Index of the last instant that is not after `time`. */
function instant(time) {
    let low = 0, high = times.length - 1;
    while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (times[middle] <= time) low = middle; else high = middle - 1;
    }
    return low;
}

const p = new THREE.Vector3(), q = new THREE.Quaternion(), r = new THREE.Quaternion();
function show(time) {
    now = time;
    const k = instant(time), next = Math.min(k + 1, times.length - 1);
    const s = times[next] > times[k] ? Math.min(1, Math.max(0, (time - times[k]) / (times[next] - times[k]))) : 0;
    for (const { poses, links, arrows } of robots) {
        if (arrows) push(arrows, k);
        links.forEach(({ group }, link) => {
            const a = 7 * (k * links.length + link), b = 7 * (next * links.length + link);
            group.visible = Number.isFinite(poses[a]);
            if (!group.visible) return;
            const mixed = Number.isFinite(poses[b]) ? s : 0, to = mixed ? b : a;
            group.position.set(poses[a], poses[a + 1], poses[a + 2]).lerp(p.set(poses[to], poses[to + 1], poses[to + 2]), mixed);
            q.set(poses[a + 3], poses[a + 4], poses[a + 5], poses[a + 6]);
            group.quaternion.copy(q).slerp(r.set(poses[to + 3], poses[to + 4], poses[to + 5], poses[to + 6]), mixed);
        });
    }
    if (layers.slips) {
        layers.slips.object.children.forEach((mark) => {
            mark.scale.setScalar(Math.abs(mark.userData.time - time) < 0.15 ? 2.2 : 1);
        });
    }
    $("time").value = time;
    $("now").textContent = time.toFixed(2) + " s";
    dirty = true;
}

function play(on) {
    playing = on && times.length > 1;
    $("play").textContent = playing ? "pause" : "play";
}

// ---- controls -------------------------------------------------------------------------------------------------------

function element(tag, parent, text, classes) {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    if (classes) made.className = classes;
    parent.append(made);
    return made;
}
const hex = (colour) => "#" + colour.toString(16).padStart(6, "0");

function paint(chosen) {
    const links = chosen === null ? [] : data.causes[chosen].links;
    for (const one of robots) {
        one.links.forEach(({ material }, k) => material.color.setHex(links.includes(k) ? CAUSE : TRACKS[one.name]));
    }
    document.querySelectorAll("button.cause").forEach((button, k) => button.setAttribute("aria-pressed", String(k === chosen)));
    dirty = true;
}

let chosen = null;
function choose(k) {
    chosen = chosen === k ? null : k;
    paint(chosen);
    if (chosen !== null && data.causes[k].time !== null && times.length) {
        play(false);
        show(Math.min(Math.max(data.causes[k].time, times[0]), times[times.length - 1]));
        look();
    }
}

const controls = $("controls");
if (data.causes.length) {
    element("h2", controls, "Causes: click to see where and when");
    data.causes.forEach((cause, k) => {
        const button = element("button", controls, cause.name, "cause");
        element("div", button, [cause.size, cause.scope].filter(Boolean).join(" · "), "soft");
        button.setAttribute("aria-pressed", "false");
        button.addEventListener("click", () => choose(k));
    });
}
element("h2", controls, "Shown");
for (const [name, { object, colour }] of Object.entries(layers)) {
    const label = element("label", controls), box = element("input", label);
    box.type = "checkbox";
    box.name = name;
    // What would hide the other at first: a splat shows the ground better than its mesh, three robots stand in each other.
    box.checked = object.visible = !((name === "ground" && layers.place) || name.endsWith("corrected") && !name.startsWith("path") && layers.simulated);
    element("span", label, "", "swatch").style.background = hex(colour);
    label.append(name);
    box.addEventListener("change", () => { object.visible = box.checked; dirty = true; });
}
if (times.length) {
    const label = element("label", controls), box = element("input", label);
    box.type = "checkbox";
    box.name = "follow";
    label.append(" follow the robot");
    box.addEventListener("change", () => { follows = box.checked; look(); });
}
if (data.mesh && data.mesh.names.length) {
    element("h2", controls, "Labels of the ground");
    data.mesh.names.forEach((name, k) => {
        const row = element("div", controls), friction = data.mesh.frictions[k];
        element("span", row, "", "swatch").style.background = hex(LABELS[k % LABELS.length]);
        row.append(friction === null ? name : `${name}, friction ${friction.toFixed(2)}`);
    });
}
element("p", controls, "Drag to turn, right button to move, wheel to zoom; W A S D Q E to fly, space to play.", "soft");

/** Turns to where the robot is. */
function look() {
    const one = robots.find(({ links }) => links[0] && links[0].group.visible);
    if (!one) return;
    const move = one.links[0].group.position.clone().sub(orbit.target);
    camera.position.add(move);
    orbit.target.add(move);
    orbit.update();
    dirty = true;
}

function start() {
    if (splat && !Number.isFinite(bounds[0][0])) {
        for (let k = 0; k < splat.count; k += Math.ceil(splat.count / 2000)) reach(...splat.places.subarray(3 * k, 3 * k + 3));
    }
    const known = Number.isFinite(bounds[0][0]), low = known ? bounds[0] : [-1, -1, 0], high = known ? bounds[1] : [1, 1, 1];
    const middle = low.map((x, c) => 0.5 * (x + high[c])), extent = Math.max(1, Math.min(3.2, Math.hypot(high[0] - low[0], high[1] - low[1])));
    const base = robots.length && robots[0].links[0] ? robots[0].links[0].group.position.toArray() : middle;
    orbit.target.set(...base);
    camera.position.set(base[0] - 0.45 * extent, base[1] - 0.55 * extent, base[2] + 0.45 * extent);
    if (!data.mesh && !splat) {
        const grid = new THREE.GridHelper(10, 20, 0x667788, 0x445566);
        grid.rotation.x = Math.PI / 2;
        layer("grid", grid, 0x667788);
    }
    orbit.update();
}

$("clock").hidden = times.length < 2;
if (times.length > 1) {
    $("time").min = times[0];
    $("time").max = times[times.length - 1];
    $("time").addEventListener("input", () => { play(false); show(Number($("time").value)); if (follows) look(); });
    $("play").addEventListener("click", () => play(!playing));
}
const held = new Set();
addEventListener("keydown", (event) => {
    if (event.target.tagName === "INPUT" && event.target.type !== "checkbox") return;
    if (event.key === " " && times.length > 1) { event.preventDefault(); play(!playing); }
    held.add(event.key.toLowerCase());
});
addEventListener("keyup", (event) => held.delete(event.key.toLowerCase()));
addEventListener("blur", () => held.clear());

const forward = new THREE.Vector3(), side = new THREE.Vector3(), move = new THREE.Vector3();
/** Moves camera and target alike while keys are held, 2 m in a second. */
function fly(seconds) {
    camera.getWorldDirection(forward);
    side.crossVectors(forward, camera.up).normalize();
    const way = (one, other) => (held.has(one) ? 1 : 0) - (held.has(other) ? 1 : 0);
    move.set(0, 0, 0).addScaledVector(forward, way("w", "s")).addScaledVector(side, way("d", "a")).addScaledVector(camera.up, way("e", "q"));
    if (move.lengthSq() === 0) return;
    move.multiplyScalar(2 * seconds);
    camera.position.add(move);
    orbit.target.add(move);
    orbit.update();
    dirty = true;
}

function resize() {
    const width = innerWidth, height = innerHeight, ratio = Math.min(devicePixelRatio || 1, 2);
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (splat) {
        const pixels = splat.material.uniforms.size.value.set(width * ratio, height * ratio);
        const focal = 0.5 * pixels.y / Math.tan((camera.fov * Math.PI) / 360);
        splat.material.uniforms.focal.value.set(focal, focal);
    }
    dirty = true;
}
addEventListener("resize", resize);

function draw() {
    if (splat && layers.place.object.visible) sort();
    renderer.render(scene, camera);
    dirty = false;
}
function frame(at) {
    const seconds = Math.min(0.1, (at - last) / 1000);
    last = at;
    if (playing) {
        const end = times[times.length - 1], next = now + seconds;
        show(next > end ? times[0] : next);
        if (follows) look();
    }
    fly(seconds);
    if (dirty) draw();
    requestAnimationFrame(frame);
}

if (times.length) show(times[0]);
start();
resize();
draw();
requestAnimationFrame(frame);

// For tests: what is shown, as numbers.
globalThis.qvView = {
    state() {
        draw();
        const gl = renderer.getContext(), size = [gl.drawingBufferWidth, gl.drawingBufferHeight], pixels = new Uint8Array(4 * size[0] * size[1]);
        gl.readPixels(0, 0, size[0], size[1], gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        let sum = 0, red = 0;
        const colours = new Set();
        for (let k = 0; k < pixels.length; k += 4) {
            sum = (sum * 31 + pixels[k] + 3 * pixels[k + 1] + 7 * pixels[k + 2]) >>> 0;
            colours.add((pixels[k] >> 4 << 8) | (pixels[k + 1] >> 4 << 4) | (pixels[k + 2] >> 4));
            if (pixels[k] > 120 && pixels[k + 1] < 80 && pixels[k + 2] < 100) red++;
        }
        return {
            layers: Object.fromEntries(Object.entries(layers).map(([name, { object }]) => [name, object.visible])),
            time: now, playing, chosen, camera: camera.position.toArray(), target: orbit.target.toArray(), picture: sum, colours: colours.size, red,
            gaussians: splat ? splat.count : 0, base: robots.length ? robots[0].links[0].group.position.toArray() : null,
            forces: Object.fromEntries(robots.filter((one) => one.arrows).map((one) => [one.name, [...one.arrows.now]])),
            error: gl.getError(), triangles: renderer.info.render.triangles,
        };
    },
};
})();
