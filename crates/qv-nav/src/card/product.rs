//! Matrix products on the card: the text of a shader for each, with all sizes in it.
//!
//! All that a network does but its memory's steps is `C = A B`, with A read through a function: rows of numbers, patches of a picture, or either
//! turned round. Tiles of A and B go through the workgroup's memory; each of 256 threads sums up a few numbers of C, over depth in order.

use std::fmt::Write;

/// Threads of a workgroup.
pub(super) const THREADS: usize = 256;
/// Depth of the tiles.
const DEPTH: usize = 32;

/// Rows and columns of C that a workgroup and each of its threads work on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    rows: usize,
    columns: usize,
    each: [usize; 2],
}

impl Tile {
    /// Square, for products of two wide matrices.
    pub const SQUARE: Self = Self { rows: 32, columns: 32, each: [2, 2] };

    /// For many rows of 16 or 32 columns.
    pub fn tall(columns: usize) -> Self {
        if columns.is_multiple_of(32) {
            Self { rows: 64, columns: 32, each: [4, 2] }
        } else {
            Self { rows: 128, columns: 16, each: [4, 2] }
        }
    }

    /// For few rows of 16 or 32 columns, and much depth.
    pub fn deep(columns: usize) -> Self {
        if columns.is_multiple_of(32) { Self::SQUARE } else { Self { rows: 32, columns: 16, each: [1, 2] } }
    }
}

/// One product.
#[derive(Debug, Clone)]
pub(super) struct Product {
    /// Rows, depth, columns.
    pub size: [usize; 3],
    pub tile: Tile,
    /// Parts of the depth that are summed on their own; `store` knows which.
    pub splits: usize,
    /// Whether rows of A lie next to each other in memory, and not numbers of a row.
    pub a_by_rows: bool,
    /// Whether B is read along its depth in memory.
    pub b_by_depth: bool,
    /// What it reads, and what it writes.
    pub reads: Vec<&'static str>,
    pub writes: Vec<&'static str>,
    /// Bodies of `a(row, depth) -> f32`, `b(depth, column) -> f32` and `store(row, column, split, sum)`.
    pub a: String,
    pub b: String,
    pub store: String,
}

impl Product {
    /// Depth of a split, a multiple of the tile's.
    fn part(&self) -> usize {
        self.size[1].div_ceil(self.splits).next_multiple_of(DEPTH)
    }

    /// Workgroups along the three axes.
    pub fn groups(&self) -> [u32; 3] {
        let [rows, depth, columns] = self.size;
        let counts = [rows.div_ceil(self.tile.rows), columns.div_ceil(self.tile.columns), depth.div_ceil(self.part())];
        counts.map(|count| count as u32)
    }

    /// Splits that have something to sum.
    pub fn parts(&self) -> usize {
        self.size[1].div_ceil(self.part())
    }

    /// The shader.
    pub fn text(&self) -> String {
        let [rows, depth, columns] = self.size;
        let Tile { rows: tall, columns: wide, each: [m, n] } = self.tile;
        let (across, stride) = (wide / n, tall + 1);
        let mut out = declare(&self.reads, &self.writes);
        let (a, b, store, part) = (&self.a, &self.b, &self.store, self.part());
        let (down, width) = (tall / m, wide / n);
        let (a_row, a_at) = if self.a_by_rows {
            (format!("i % {tall}u"), format!("i / {tall}u"))
        } else {
            (format!("i / {DEPTH}u"), format!("i % {DEPTH}u"))
        };
        let (b_column, b_at) = if self.b_by_depth {
            (format!("i / {DEPTH}u"), format!("i % {DEPTH}u"))
        } else {
            (format!("i % {wide}u"), format!("i / {wide}u"))
        };
        let _ = write!(
            out,
            "var<workgroup> left: array<f32, {left}>;
var<workgroup> right: array<f32, {right}>;
fn a(row: u32, depth: u32) -> f32 {{ {a} }}
fn b(depth: u32, column: u32) -> f32 {{ {b} }}
fn store(row: u32, column: u32, split: u32, sum: f32) {{ {store} }}
@compute @workgroup_size({THREADS})
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {{
  let first = vec2<u32>(group.x * {tall}u, group.y * {wide}u);
  let end = min((group.z + 1u) * {part}u, {depth}u);
  let x = thread % {across}u;
  let y = thread / {across}u;
",
            left = DEPTH * stride,
            right = DEPTH * (wide + 1),
        );
        let cells = || (0..m).flat_map(|i| (0..n).map(move |j| (i, j)));
        cells().for_each(|(i, j)| _ = writeln!(out, "  var c{i}_{j} = 0.0;"));
        let _ = write!(
            out,
            "  for (var depth_at = group.z * {part}u; depth_at < end; depth_at += {DEPTH}u) {{
    for (var i = thread; i < {a_count}u; i += {THREADS}u) {{
      let row = first.x + {a_row};
      let depth = depth_at + {a_at};
      var value = 0.0;
      if row < {rows}u && depth < end {{ value = a(row, depth); }}
      left[({a_at}) * {stride}u + {a_row}] = value;
    }}
    for (var i = thread; i < {b_count}u; i += {THREADS}u) {{
      let column = first.y + {b_column};
      let depth = depth_at + {b_at};
      var value = 0.0;
      if column < {columns}u && depth < end {{ value = b(depth, column); }}
      right[({b_at}) * {b_stride}u + {b_column}] = value;
    }}
    workgroupBarrier();
    for (var k = 0u; k < {DEPTH}u; k++) {{
",
            a_count = tall * DEPTH,
            b_count = wide * DEPTH,
            b_stride = wide + 1,
        );
        (0..m).for_each(|i| _ = writeln!(out, "      let a{i} = left[k * {stride}u + y + {}u];", i * down));
        (0..n).for_each(|j| _ = writeln!(out, "      let b{j} = right[k * {}u + x + {}u];", wide + 1, j * width));
        cells().for_each(|(i, j)| _ = writeln!(out, "      c{i}_{j} = fma(a{i}, b{j}, c{i}_{j});"));
        out += "    }\n    workgroupBarrier();\n  }\n";
        for (i, j) in cells() {
            let (row, column) = (format!("first.x + y + {}u", i * down), format!("first.y + x + {}u", j * width));
            let _ = writeln!(
                out,
                "  if {row} < {rows}u && {column} < {columns}u {{ store({row}, {column}, group.z, c{i}_{j}); }}"
            );
        }
        out += "}\n";
        out
    }
}

/// Declarations of buffers, in the order in which they are bound.
pub(super) fn declare(reads: &[&str], writes: &[&str]) -> String {
    let mut out = String::new();
    let all = reads.iter().map(|name| (name, "read")).chain(writes.iter().map(|name| (name, "read_write")));
    for (k, (name, access)) in all.enumerate() {
        let kind = if ["pictures", "lanes"].contains(name) { "u32" } else { "f32" };
        let _ = writeln!(out, "@group(0) @binding({k}) var<storage, {access}> {name}: array<{kind}>;");
    }
    out
}
