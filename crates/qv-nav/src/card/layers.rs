//! The shaders of a step of the optimiser: the network of [`crate::net`] forwards and back, the loss of [`crate::dagger`], Adam.
//!
//! A row of all matrices is one decision: lane times stretch plus step. Decisions beyond the end of a lane have no loss, so no gradient.

use super::product::{Product, THREADS, Tile, declare};
use crate::loss::LONGEST;
use crate::net::{COLOUR, COMMAND, Conv, HIDDEN, KNOWN, Net, OUTPUTS, RAW, RAW_SIGHT, SIGHT, STATE, Tint};
use crate::recall::RECALL;
use crate::roll::StudentAction;
use crate::settings::{PolicySettings, TrainSettings};
use qv_policy::net::{Dense, padded};

/// Numbers that a decision is judged by: command, cone, whether it was found, what else is known, what is said of the picture; then what was done, its
/// mean, and the advantage, for PPO.
pub(super) const TARGET: usize = COMMAND + 4 + 1 + KNOWN + SIGHT + StudentAction::NUMBERS;
/// Numbers of a step: rate, unbias, scale of the gradient, its greatest length.
pub(super) const HYPER: usize = 4;
/// Partial sums of the gradient's square.
const PARTS: usize = 256;

/// One dispatch.
#[derive(Debug, Clone)]
pub(super) struct Kernel {
    pub label: String,
    pub text: String,
    /// Names of buffers, in the order of their bindings.
    pub buffers: Vec<&'static str>,
    pub groups: [u32; 3],
}

/// Buffers by name and count of numbers, and what is dispatched in turn.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub buffers: Vec<(&'static str, usize)>,
    pub kernels: Vec<Kernel>,
}

/// Outcomes of convolutions, and their gradients.
const SEEN: [&str; 4] = ["seen0", "seen1", "seen2", "seen3"];
const OF_SEEN: [&str; 4] = ["of_seen0", "of_seen1", "of_seen2", "of_seen3"];
/// Workgroups for sums over pixels and decisions.
const SPLITS: [usize; 4] = [512, 128, 64, 32];

/// `if (x > 0) 1 else x + 1`: the slope of ELU by its outcome.
const SLOPE: &str = "let at = outcome; let slope = select(at + 1.0, 1.0, at > 0.0);";

impl Plan {
    /// For a network, so many lanes and steps of a stretch.
    pub fn new(net: &Net, settings: &TrainSettings) -> Self {
        let (lanes, steps) = (settings.batch, settings.truncated);
        let rows = lanes * steps;
        let mut plan = Self { buffers: Vec::new(), kernels: Vec::new() };
        plan.make_room(net, lanes, rows);
        plan.forwards(net, lanes, steps);
        plan.add(
            "loss",
            &["raw", "sight", "targets", "lanes"],
            &["of_raw", "of_sight", "losses"],
            rows,
            loss(settings),
        );
        plan.backwards(net, lanes, steps);
        plan.gradients(net, steps, rows);
        plan.optimise(net, lanes, steps);
        plan
    }

    fn make_room(&mut self, net: &Net, lanes: usize, rows: usize) {
        let count = net.len();
        self.buffers.extend(["parameters", "gradient", "first", "second"].map(|name| (name, count)));
        self.buffers.extend([("squares", PARTS), ("hyper", HYPER), ("lanes", 2 * lanes), ("past", lanes * HIDDEN)]);
        self.buffers.push(("turned", 3 * HIDDEN * HIDDEN));
        let sizes = [
            ("pictures", net.picture_len() / 4),
            ("states", STATE),
            ("recalls", RECALL),
            ("targets", TARGET),
            ("losses", 1),
            ("dense", net.dense.outputs),
            ("sight", RAW_SIGHT),
            ("mix", net.mix.outputs),
            ("gates", 3 * HIDDEN),
            ("candidates", HIDDEN),
            ("memory", HIDDEN),
            ("head", net.head.outputs),
            ("raw", RAW),
            ("of_raw", RAW),
            ("of_sight", RAW_SIGHT),
            ("of_head", net.head.outputs),
            ("of_memory", HIDDEN),
            ("of_input", 3 * HIDDEN),
            ("of_state", 3 * HIDDEN),
            ("of_mix", net.mix.outputs),
            ("of_dense", net.dense.outputs),
        ];
        self.buffers.extend(sizes.map(|(name, each)| (name, rows * each)));
        let mut partial = 0;
        for (k, conv) in net.convolutions.iter().enumerate() {
            let pixels = conv.to[0] * conv.to[1] * conv.to[2];
            self.buffers.extend([(SEEN[k], rows * pixels), (OF_SEEN[k], rows * pixels)]);
            partial = partial.max(SPLITS[k] * (conv.dense.inputs + 1 + COLOUR) * conv.to[2]);
        }
        self.buffers.push(("pieces", partial));
    }

    fn product(&mut self, label: &str, product: &Product) {
        let buffers = product.reads.iter().chain(&product.writes).copied().collect();
        let (text, groups) = (product.text(), product.groups());
        self.kernels.push(Kernel { label: label.into(), text, buffers, groups });
    }

    /// A kernel with a thread for each of `count` things, `i`.
    fn add(&mut self, label: &str, reads: &[&'static str], writes: &[&'static str], count: usize, body: String) {
        let text = format!(
            "{}@compute @workgroup_size({THREADS})
fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
  let i = id.x;
  if i >= {count}u {{ return; }}
  {body}
}}
",
            declare(reads, writes)
        );
        let buffers = reads.iter().chain(writes).copied().collect();
        let groups = [count.div_ceil(THREADS) as u32, 1, 1];
        self.kernels.push(Kernel { label: label.into(), text, buffers, groups });
    }

    fn forwards(&mut self, net: &Net, lanes: usize, steps: usize) {
        let rows = lanes * steps;
        let fresh = format!("if lanes[2u * (i / {HIDDEN}u)] == 1u {{ past[i] = 0.0; }}");
        self.add("begin", &["lanes"], &["past"], lanes * HIDDEN, fresh);
        for (k, conv) in net.convolutions.iter().enumerate() {
            self.convolve(conv, net.tints.get(k), k, rows);
        }
        let last = net.dense.inputs - STATE;
        let seen = SEEN[net.convolutions.len() - 1];
        let after_state = beside(seen, last, "states", STATE);
        self.dense("dense", &net.dense, rows, (&[seen, "states"], &after_state), "dense", true);
        self.dense("sight", &net.sight, rows, (&["dense"], &row_of("dense", net.dense.outputs)), "sight", false);
        let after_recall = beside("dense", net.dense.outputs, "recalls", RECALL);
        self.dense("mix", &net.mix, rows, (&["dense", "recalls"], &after_recall), "mix", true);
        self.dense("gru", &net.gru.from_input, rows, (&["mix"], &row_of("mix", net.mix.outputs)), "gates", false);
        self.remember(&net.gru.from_state, lanes, steps);
        self.dense("head", &net.head, rows, (&["memory"], &row_of("memory", HIDDEN)), "head", true);
        self.dense("last", &net.last, rows, (&["head"], &row_of("head", net.head.outputs)), "raw", false);
    }

    /// `out = act(A W + bias)`.
    fn dense(
        &mut self,
        label: &str,
        layer: &Dense,
        rows: usize,
        (reads, a): (&[&'static str], &str),
        out: &'static str,
        bent: bool,
    ) {
        let width = padded(layer.outputs);
        let bias = layer.start + padded(layer.inputs) * width;
        let act = if bent { "select(exp(min(x, 0.0)) - 1.0, x, x > 0.0)" } else { "x" };
        self.product(
            label,
            &Product {
                size: [rows, layer.inputs, width],
                tile: Tile::SQUARE,
                splits: 1,
                a_by_rows: false,
                b_by_depth: false,
                reads: [reads, &["parameters"]].concat(),
                writes: vec![out],
                a: a.into(),
                b: format!("return parameters[{}u + depth * {width}u + column];", layer.start),
                store: format!("let x = sum + parameters[{bias}u + column]; {out}[row * {width}u + column] = {act};"),
            },
        );
    }

    fn convolve(&mut self, conv: &Conv, tint: Option<&Tint>, k: usize, rows: usize) {
        let (channels, inputs) = (conv.to[2], conv.dense.inputs);
        let bias = conv.dense.start + padded(inputs) * channels;
        let colours = tint.map_or(0, |_| COLOUR);
        let start = conv.dense.start;
        let shift = tint.map_or(String::new(), |tint| {
            format!(
                "if depth >= {inputs}u {{ return parameters[{}u + (depth - {inputs}u) * {channels}u + column]; }}",
                tint.start
            )
        });
        let (reads, a) = patches(conv, k, tint.is_some());
        let out = SEEN[k];
        self.product(
            &format!("conv{k}"),
            &Product {
                size: [rows * conv.to[0] * conv.to[1], inputs + colours, channels],
                tile: Tile::tall(channels),
                splits: 1,
                a_by_rows: false,
                b_by_depth: false,
                reads: [&reads[..], &["parameters"]].concat(),
                writes: vec![out],
                a,
                b: format!("{shift} return parameters[{start}u + depth * {channels}u + column];"),
                store: format!(
                    "let x = sum + parameters[{bias}u + column];
                     {out}[row * {channels}u + column] = select(exp(min(x, 0.0)) - 1.0, x, x > 0.0);"
                ),
            },
        );
    }

    /// The memory of each lane through all its steps: one workgroup a lane, one thread a unit, so that a step waits for no dispatch.
    fn remember(&mut self, layer: &Dense, lanes: usize, steps: usize) {
        let bias = layer.start + padded(layer.inputs) * padded(layer.outputs);
        let (three, two, start) = (3 * HIDDEN, 2 * HIDDEN, layer.start);
        let (reads, writes) = (["parameters", "past"], ["gates", "candidates", "memory"]);
        let body = format!(
            "  before[unit] = past[lane * {HIDDEN}u + unit];
  let biases = vec3<f32>(parameters[{bias}u + unit], parameters[{bias}u + {HIDDEN}u + unit], parameters[{bias}u + {two}u + unit]);
  for (var step = 0u; step < {steps}u; step++) {{
    workgroupBarrier();
    var sums = biases;
    for (var k = 0u; k < {HIDDEN}u; k++) {{
      let at = {start}u + k * {three}u + unit;
      sums = fma(vec3<f32>(before[k]), vec3<f32>(parameters[at], parameters[at + {HIDDEN}u], parameters[at + {two}u]), sums);
    }}
    let row = lane * {steps}u + step;
    let at = row * {three}u + unit;
    let r = 1.0 / (1.0 + exp(-clamp(gates[at] + sums.x, -60.0, 60.0)));
    let z = 1.0 / (1.0 + exp(-clamp(gates[at + {HIDDEN}u] + sums.y, -60.0, 60.0)));
    let n = 1.0 - 2.0 / (1.0 + exp(clamp(2.0 * (gates[at + {two}u] + r * sums.z), -60.0, 60.0)));
    gates[at] = r;
    gates[at + {HIDDEN}u] = z;
    gates[at + {two}u] = n;
    candidates[row * {HIDDEN}u + unit] = sums.z;
    let now = (1.0 - z) * n + z * before[unit];
    memory[row * {HIDDEN}u + unit] = now;
    workgroupBarrier();
    before[unit] = now;
  }}
"
        );
        self.by_lanes("remember", (&reads, &writes), ("before", HIDDEN), body, lanes);
    }

    /// A kernel with a workgroup for each lane, `lane`, and a thread for each unit of the memory, `unit`; they share an array.
    fn by_lanes(
        &mut self,
        label: &str,
        (reads, writes): (&[&'static str], &[&'static str]),
        (shared, count): (&str, usize),
        body: String,
        lanes: usize,
    ) {
        let text = format!(
            "{}var<workgroup> {shared}: array<f32, {count}>;
@compute @workgroup_size({HIDDEN})
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) unit: u32) {{
  let lane = group.x;
{body}}}
",
            declare(reads, writes)
        );
        let buffers = reads.iter().chain(writes).copied().collect();
        self.kernels.push(Kernel { label: label.into(), text, buffers, groups: [lanes as u32, 1, 1] });
    }

    fn backwards(&mut self, net: &Net, lanes: usize, steps: usize) {
        let rows = lanes * steps;
        self.back("of_head", &net.last, rows, "of_raw", ("of_head", net.head.outputs), Some("head"));
        self.back("of_memory", &net.head, rows, "of_head", ("of_memory", HIDDEN), None);
        self.forget(&net.gru.from_state, lanes, steps);
        self.back("of_mix", &net.gru.from_input, rows, "of_input", ("of_mix", net.mix.outputs), Some("mix"));
        self.back_to_dense(net, rows);
        let last = net.convolutions.len() - 1;
        let features = net.dense.inputs - STATE;
        self.back(OF_SEEN[last], &net.dense, rows, "of_dense", (OF_SEEN[last], features), Some(SEEN[last]));
        for k in (1..=last).rev() {
            self.back_through(&net.convolutions[k], k, rows);
        }
    }

    /// `out = of W'`, times the slope of ELU; of the first `width` inputs alone.
    fn back(
        &mut self,
        label: &str,
        layer: &Dense,
        rows: usize,
        of: &'static str,
        (out, width): (&'static str, usize),
        bent: Option<&'static str>,
    ) {
        let columns = padded(layer.outputs);
        let mut reads = vec![of, "parameters"];
        reads.extend(bent);
        let slope =
            bent.map_or(String::new(), |outcome| format!("let outcome = {outcome}[row * {width}u + column]; {SLOPE}"));
        let times = if bent.is_some() { " * slope" } else { "" };
        self.product(
            label,
            &Product {
                size: [rows, layer.outputs, width],
                tile: Tile::SQUARE,
                splits: 1,
                a_by_rows: false,
                b_by_depth: true,
                reads,
                writes: vec![out],
                a: row_of(of, columns),
                b: format!("return parameters[{}u + column * {columns}u + depth];", layer.start),
                store: format!("{slope} {out}[row * {width}u + column] = sum{times};"),
            },
        );
    }

    /// The picture's dense layer has its gradient from what is said of the picture, and from the layer behind it.
    fn back_to_dense(&mut self, net: &Net, rows: usize) {
        let (mix, sight, width) = (net.mix.outputs, padded(net.sight.outputs), net.dense.outputs);
        let (of_mix, of_sight) = (net.mix.start, net.sight.start);
        self.product(
            "of_dense",
            &Product {
                size: [rows, mix + sight, width],
                tile: Tile::SQUARE,
                splits: 1,
                a_by_rows: false,
                b_by_depth: true,
                reads: vec!["of_mix", "of_sight", "parameters", "dense"],
                writes: vec!["of_dense"],
                a: beside("of_mix", mix, "of_sight", sight),
                b: format!(
                    "if depth < {mix}u {{ return parameters[{of_mix}u + column * {mix}u + depth]; }}
                     return parameters[{of_sight}u + column * {sight}u + depth - {mix}u];"
                ),
                store: format!(
                    "let outcome = dense[row * {width}u + column]; {SLOPE} of_dense[row * {width}u + column] = sum * slope;"
                ),
            },
        );
    }

    /// The gradient of a convolution's input.
    fn back_through(&mut self, conv: &Conv, k: usize, rows: usize) {
        let ([height, width, from], [high, wide, to]) = (conv.from, conv.to);
        let (side, stride, margin, start) = (conv.side, conv.stride, conv.side / 2, conv.dense.start);
        let (of, out, outcome) = (OF_SEEN[k], OF_SEEN[k - 1], SEEN[k - 1]);
        let pixels = height * width;
        self.product(
            out,
            &Product {
                size: [rows * pixels, side * side * to, from],
                tile: Tile::tall(from),
                splits: 1,
                a_by_rows: false,
                b_by_depth: true,
                reads: vec![of, "parameters", outcome],
                writes: vec![out],
                a: format!(
                    "let pixel = row % {pixels}u;
                     let tap = depth / {to}u;
                     let y = pixel / {width}u + {margin}u;
                     let x = pixel % {width}u + {margin}u;
                     let ky = tap / {side}u;
                     let kx = tap % {side}u;
                     if y < ky || x < kx {{ return 0.0; }}
                     let at = vec2<u32>(y - ky, x - kx);
                     if at.x % {stride}u != 0u || at.y % {stride}u != 0u {{ return 0.0; }}
                     let there = at / {stride}u;
                     if there.x >= {high}u || there.y >= {wide}u {{ return 0.0; }}
                     return {of}[(((row / {pixels}u) * {high}u + there.x) * {wide}u + there.y) * {to}u + depth % {to}u];"
                ),
                b: format!(
                    "return parameters[{start}u + ((depth / {to}u) * {from}u + column) * {to}u + depth % {to}u];"
                ),
                store: format!(
                    "let outcome = {outcome}[row * {from}u + column]; {SLOPE} {out}[row * {from}u + column] = sum * slope;"
                ),
            },
        );
    }

    /// The way back through the memory of each lane. It reads the weights by output, so that threads beside each other read what lies beside
    /// each other.
    fn forget(&mut self, layer: &Dense, lanes: usize, steps: usize) {
        let (three, two, start) = (3 * HIDDEN, 2 * HIDDEN, layer.start);
        let turn = format!("turned[i] = parameters[{start}u + (i % {HIDDEN}u) * {three}u + i / {HIDDEN}u];");
        self.add("turn", &["parameters"], &["turned"], three * HIDDEN, turn);
        let reads = ["turned", "past", "gates", "candidates", "memory", "of_memory"];
        let writes = ["of_input", "of_state"];
        let body = format!(
            "  var kept = 0.0;
  for (var back = 0u; back < {steps}u; back++) {{
    let row = lane * {steps}u + {steps}u - 1u - back;
    let here = row * {HIDDEN}u + unit;
    var after = of_memory[here];
    if back > 0u {{
      var sum = kept;
      for (var k = 0u; k < {three}u; k++) {{
        sum = fma(next[k], turned[k * {HIDDEN}u + unit], sum);
      }}
      after += sum;
    }}
    var before = 0.0;
    if back + 1u == {steps}u {{ before = past[lane * {HIDDEN}u + unit]; }} else {{ before = memory[here - {HIDDEN}u]; }}
    let at = row * {three}u + unit;
    let r = gates[at];
    let z = gates[at + {HIDDEN}u];
    let n = gates[at + {two}u];
    let of_n = after * (1.0 - z) * (1.0 - n * n);
    let of_z = after * (before - n) * z * (1.0 - z);
    let of_r = of_n * candidates[here] * r * (1.0 - r);
    of_input[at] = of_r;
    of_input[at + {HIDDEN}u] = of_z;
    of_input[at + {two}u] = of_n;
    of_state[at] = of_r;
    of_state[at + {HIDDEN}u] = of_z;
    of_state[at + {two}u] = of_n * r;
    workgroupBarrier();
    next[unit] = of_r;
    next[{HIDDEN}u + unit] = of_z;
    next[{two}u + unit] = of_n * r;
    kept = after * z;
    workgroupBarrier();
  }}
"
        );
        self.by_lanes("forget", (&reads, &writes), ("next", three), body, lanes);
    }

    fn gradients(&mut self, net: &Net, steps: usize, rows: usize) {
        let last = net.convolutions.len() - 1;
        let features = net.dense.inputs - STATE;
        let before = format!(
            "if row < {HIDDEN}u {{
               if depth % {steps}u == 0u {{ return past[(depth / {steps}u) * {HIDDEN}u + row]; }}
               return memory[(depth - 1u) * {HIDDEN}u + row];
             }}
             return 1.0;"
        );
        let across = |buffer: &str, width: usize| {
            format!("if row < {width}u {{ return {buffer}[depth * {width}u + row]; }} return 1.0;")
        };
        let two = |first: &str, width: usize, second: &str, count: usize| {
            format!(
                "if row < {width}u {{ return {first}[depth * {width}u + row]; }}
                 if row < {}u {{ return {second}[depth * {count}u + row - {width}u]; }}
                 return 1.0;",
                width + count
            )
        };
        let (dense, mix, head) = (net.dense.outputs, net.mix.outputs, net.head.outputs);
        let of_dense = two(SEEN[last], features, "states", STATE);
        let list: [(&Dense, Vec<&'static str>, String, &'static str); 7] = [
            (&net.last, vec!["head"], across("head", head), "of_raw"),
            (&net.head, vec!["memory"], across("memory", HIDDEN), "of_head"),
            (&net.gru.from_input, vec!["mix"], across("mix", mix), "of_input"),
            (&net.gru.from_state, vec!["past", "memory"], before, "of_state"),
            (&net.mix, vec!["dense", "recalls"], two("dense", dense, "recalls", RECALL), "of_mix"),
            (&net.sight, vec!["dense"], across("dense", dense), "of_sight"),
            (&net.dense, vec![SEEN[last], "states"], of_dense, "of_dense"),
        ];
        for (layer, reads, a, of) in list {
            let (width, inputs) = (padded(layer.outputs), layer.inputs);
            let bias = layer.start + padded(inputs) * width;
            let product = Product {
                size: [inputs + 1, rows, width],
                tile: Tile::SQUARE,
                splits: 1,
                a_by_rows: true,
                b_by_depth: false,
                reads: [&reads[..], &[of]].concat(),
                writes: vec!["gradient"],
                a,
                b: row_at(of, width),
                store: format!(
                    "if row < {inputs}u {{ gradient[{}u + row * {width}u + column] = sum; }}
                     else {{ gradient[{bias}u + column] = sum; }}",
                    layer.start
                ),
            };
            self.product(&format!("by {of}"), &product);
        }
        for (k, conv) in net.convolutions.iter().enumerate() {
            self.conv_gradient(conv, net.tints.get(k), k, rows);
        }
    }

    /// Weights, then biases, then what the colour adds: sums over all pixels in parts, which are then summed.
    fn conv_gradient(&mut self, conv: &Conv, tint: Option<&Tint>, k: usize, rows: usize) {
        let (channels, inputs) = (conv.to[2], conv.dense.inputs);
        let colours = tint.map_or(0, |_| COLOUR);
        let (count, of) = (inputs + 1 + colours, OF_SEEN[k]);
        let (mut reads, patch) = patches(conv, k, tint.is_some());
        reads.push(of);
        let product = Product {
            size: [count, rows * conv.to[0] * conv.to[1], channels],
            tile: Tile::deep(channels),
            splits: SPLITS[k],
            a_by_rows: true,
            b_by_depth: false,
            reads,
            writes: vec!["pieces"],
            // The patches' rows are this product's depth. The bias comes between weights and colours.
            a: format!(
                "if row == {inputs}u {{ return 1.0; }}
                 return patched(depth, select(row, row - 1u, row > {inputs}u));
                 }}
                 fn patched(row: u32, depth: u32) -> f32 {{ {patch}"
            ),
            b: row_at(of, channels),
            store: format!("pieces[(split * {count}u + row) * {channels}u + column] = sum;"),
        };
        self.product(&format!("by {of}"), &product);
        let (parts, all) = (product.parts(), count * channels);
        let start = conv.dense.start;
        let bias = start + padded(inputs) * channels;
        let tint_at = tint.map_or(0, |tint| tint.start);
        let body = format!(
            "var sum = 0.0;
  for (var k = 0u; k < {parts}u; k++) {{ sum += pieces[k * {all}u + i]; }}
  let row = i / {channels}u;
  let column = i % {channels}u;
  if row < {inputs}u {{ gradient[{start}u + i] = sum; }}
  else if row == {inputs}u {{ gradient[{bias}u + column] = sum; }}
  else {{ gradient[{tint_at}u + i - {}u] = sum; }}",
            (inputs + 1) * channels
        );
        self.add(&format!("sum {of}"), &["pieces"], &["gradient"], all, body);
    }

    /// The gradient's length, Adam, and the memories that the next stretch begins with.
    fn optimise(&mut self, net: &Net, lanes: usize, steps: usize) {
        let count = net.len();
        let each = count.div_ceil(PARTS);
        let tree = |what: &str| {
            format!(
                "sums[thread] = {what};
  workgroupBarrier();
  for (var half = {}u; half > 0u; half /= 2u) {{
    if thread < half {{ sums[thread] += sums[thread + half]; }}
    workgroupBarrier();
  }}",
                THREADS / 2
            )
        };
        let head = format!(
            "var<workgroup> sums: array<f32, {THREADS}>;
@compute @workgroup_size({THREADS})
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {{"
        );
        let text = format!(
            "{}{head}
  let end = min((group.x + 1u) * {each}u, {count}u);
  var sum = 0.0;
  for (var i = group.x * {each}u + thread; i < end; i += {THREADS}u) {{
    let g = gradient[i] * hyper[2];
    sum = fma(g, g, sum);
  }}
  {}
  if thread == 0u {{ squares[group.x] = sums[0]; }}
}}
",
            declare(&["gradient", "hyper"], &["squares"]),
            tree("sum")
        );
        let buffers = vec!["gradient", "hyper", "squares"];
        self.kernels.push(Kernel { label: "squares".into(), text, buffers, groups: [PARTS as u32, 1, 1] });
        let text = format!(
            "{}{head}
  {}
  let length = sqrt(sums[0]);
  let i = group.x * {THREADS}u + thread;
  if i >= {count}u {{ return; }}
  var scale = hyper[2];
  if length > hyper[3] {{ scale *= hyper[3] / length; }}
  let g = gradient[i] * scale;
  let mean = 0.9 * first[i] + 0.1 * g;
  let square = 0.999 * second[i] + 0.001 * g * g;
  first[i] = mean;
  second[i] = square;
  parameters[i] -= hyper[0] * mean / (sqrt(square * hyper[1]) + 1e-8);
}}
",
            declare(&["gradient", "hyper", "squares"], &["parameters", "first", "second"]),
            tree("squares[thread]")
        );
        let buffers = vec!["gradient", "hyper", "squares", "parameters", "first", "second"];
        let groups = [count.div_ceil(THREADS) as u32, 1, 1];
        self.kernels.push(Kernel { label: "adam".into(), text, buffers, groups });
        let body = format!(
            "let count = lanes[2u * (i / {HIDDEN}u) + 1u];
  if count > 0u {{ past[i] = memory[((i / {HIDDEN}u) * {steps}u + count - 1u) * {HIDDEN}u + i % {HIDDEN}u]; }}"
        );
        self.add("end", &["lanes", "memory"], &["past"], lanes * HIDDEN, body);
    }
}

/// Rows of one buffer.
fn row_of(buffer: &str, width: usize) -> String {
    format!("return {buffer}[row * {width}u + depth];")
}

/// The same as B: rows are the depth.
fn row_at(buffer: &str, width: usize) -> String {
    format!("return {buffer}[depth * {width}u + column];")
}

/// Rows of one buffer, and behind them those of another.
fn beside(first: &str, width: usize, second: &str, count: usize) -> String {
    format!(
        "if depth < {width}u {{ return {first}[row * {width}u + depth]; }}
         return {second}[row * {count}u + depth - {width}u];"
    )
}

/// What a convolution reads, and its patches: a row for each pixel of the outcome, behind it, where it has a tint, the colour.
fn patches(conv: &Conv, k: usize, tinted: bool) -> (Vec<&'static str>, String) {
    let ([height, width, from], [high, wide, _]) = (conv.from, conv.to);
    let (side, stride, margin) = (conv.side, conv.stride, conv.side / 2);
    let pixels = high * wide;
    let mut reads = vec![if k == 0 { "pictures" } else { SEEN[k - 1] }];
    let colour = if tinted {
        reads.push("states");
        let inputs = conv.dense.inputs;
        format!("if depth >= {inputs}u {{ return states[(row / {pixels}u) * {STATE}u + depth - {inputs}u]; }}")
    } else {
        String::new()
    };
    let value = if k == 0 {
        "return f32((pictures[at / 4u] >> (8u * (at % 4u))) & 255u) * (2.0 / 255.0) - 1.0;".to_string()
    } else {
        format!("return {}[at];", SEEN[k - 1])
    };
    let text = format!(
        "{colour}
         let pixel = row % {pixels}u;
         let tap = depth / {from}u;
         let y = (pixel / {wide}u) * {stride}u + tap / {side}u;
         let x = (pixel % {wide}u) * {stride}u + tap % {side}u;
         if y < {margin}u || x < {margin}u || y >= {}u || x >= {}u {{ return 0.0; }}
         let at = (((row / {pixels}u) * {height}u + y - {margin}u) * {width}u + x - {margin}u) * {from}u + depth % {from}u;
         {value}",
        height + margin,
        width + margin,
    );
    (reads, text)
}

/// Loss of one decision and its gradient, as [`crate::dagger`] has them.
fn loss(settings: &TrainSettings) -> String {
    let TrainSettings { huber, cone_weight, visible_weight, known_weight, ray_weight, truncated, .. } = settings;
    let (cone_at, found_at, known_at) = (COMMAND, COMMAND + 4, COMMAND + 5);
    let sight_at = known_at + KNOWN;
    let visible = OUTPUTS - 1;
    let imitation = settings.policy.map_or(1.0, |policy| policy.imitation);
    // What the gradient of a command has of PPO.
    let own = settings.policy.map_or("", |_| " + slope * (targets[acted + k] - y)");
    let surrogate = settings.policy.map_or_else(String::new, |policy| surrogate(&policy, sight_at + SIGHT));
    format!(
        "let raw_at = i * {RAW}u;
  let sight_at = i * {RAW_SIGHT}u;
  let wanted = i * {TARGET}u;
  for (var k = 0u; k < {RAW}u; k++) {{ of_raw[raw_at + k] = 0.0; }}
  for (var k = 0u; k < {RAW_SIGHT}u; k++) {{ of_sight[sight_at + k] = 0.0; }}
  if i % {truncated}u >= lanes[2u * (i / {truncated}u) + 1u] {{ return; }}
  var sum = 0.0;
  {surrogate}
  for (var k = 0u; k < {COMMAND}u; k++) {{
    let y = 1.0 - 2.0 / (1.0 + exp(clamp(2.0 * raw[raw_at + k], -60.0, 60.0)));
    let off = y - targets[wanted + k];
    sum += {imitation:?} * select({huber:?} * (abs(off) - 0.5 * {huber:?}), 0.5 * off * off, abs(off) <= {huber:?});
    let of_command = {imitation:?} * clamp(off, -{huber:?}, {huber:?}){own};
    of_raw[raw_at + k] = of_command * (1.0 - y * y);
  }}
  let found = targets[wanted + {found_at}u] > 0.5;
  if found {{
    for (var k = 0u; k < 3u; k++) {{
      let off = raw[raw_at + {COMMAND}u + k] - targets[wanted + {cone_at}u + k];
      of_raw[raw_at + {COMMAND}u + k] = {cone_weight:?} * off;
      sum += 0.5 * {cone_weight:?} * off * off;
    }}
  }}
  for (var k = 0u; k < {KNOWN}u; k++) {{
    if found || k < 4u {{
      let off = raw[raw_at + {OUTPUTS}u + k] - targets[wanted + {known_at}u + k];
      of_raw[raw_at + {OUTPUTS}u + k] = {known_weight:?} * off;
      sum += 0.5 * {known_weight:?} * off * off;
    }}
  }}
  let seen = raw[raw_at + {visible}u];
  let is_seen = targets[wanted + {cone_at}u + 3u];
  of_raw[raw_at + {visible}u] = {visible_weight:?} * (1.0 / (1.0 + exp(-clamp(seen, -60.0, 60.0))) - is_seen);
  sum += {visible_weight:?} * (max(seen, 0.0) - seen * is_seen + log(1.0 + exp(-abs(seen))));
  for (var k = 0u; k < {SIGHT}u; k++) {{
    let target_value = targets[wanted + {sight_at}u + k];
    let x = sight[sight_at + k];
    if k == 3u {{
      of_sight[sight_at + k] = {visible_weight:?} * (1.0 / (1.0 + exp(-clamp(x, -60.0, 60.0))) - target_value);
      sum += {visible_weight:?} * (max(x, 0.0) - x * target_value + log(1.0 + exp(-abs(x))));
      continue;
    }}
    if k < 3u && targets[wanted + {sight_at}u + 3u] <= 0.5 {{ continue; }}
    var weight = {ray_weight:?};
    if k < 3u {{ weight = {cone_weight:?}; }} else if k < 8u {{ weight = {known_weight:?}; }}
    let off = x - target_value;
    of_sight[sight_at + k] = weight * off;
    sum += 0.5 * weight * off * off;
  }}
  losses[i] += sum;"
    )
}

/// The clipped objective as in [`crate::loss`]: adds to `sum`, and leaves `acted` and `slope`.
fn surrogate(policy: &PolicySettings, acted_at: usize) -> String {
    let PolicySettings { clip, weight, .. } = policy;
    format!(
        "let acted = wanted + {acted_at}u;
  let deviation = targets[acted + {}u];
  let inverse_variance = 1.0 / (deviation * deviation);
  var log_ratio = 0.0;
  for (var k = 0u; k < {COMMAND}u; k++) {{
    let y = 1.0 - 2.0 / (1.0 + exp(clamp(2.0 * raw[raw_at + k], -60.0, 60.0)));
    let before = targets[acted + k] - targets[acted + {COMMAND}u + k];
    let now = targets[acted + k] - y;
    log_ratio += 0.5 * inverse_variance * (before * before - now * now);
  }}
  let advantage = targets[acted + {}u];
  let ratio = exp(clamp(log_ratio, -{LONGEST:?}, {LONGEST:?}));
  let clipped = clamp(ratio, {:?}, {:?}) * advantage;
  sum -= {weight:?} * min(ratio * advantage, clipped);
  let slope = select(-{weight:?} * advantage * ratio * inverse_variance, 0.0, clipped < ratio * advantage);",
        2 * COMMAND,
        2 * COMMAND + 1,
        1.0 - clip,
        1.0 + clip,
    )
}
