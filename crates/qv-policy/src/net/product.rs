//! The one matrix product of the networks: `C += A B`.
//!
//! Every entry of C is one chain of fused multiply-adds over k in order, starting from what C holds. So blocks of rows and columns do not
//! change the bits, nor do registers of another width.

use super::simd::{Plain, WIDTH, Wide};

/// A matrix that is read by rows, by columns, or with any other two steps.
#[derive(Clone, Copy)]
pub(super) struct StridedMatrix<'a> {
    pub values: &'a [f32],
    /// Numbers from one row to the next, and from one column to the next.
    pub steps: [usize; 2],
}

/// `C += A B` for A of `rows x depth`, B of `depth x width` and C of `rows x width`, both by rows; `width` is a multiple of
/// sixteen.
pub(super) fn add_product(rows: usize, depth: usize, width: usize, a: StridedMatrix, b: &[f32], c: &mut [f32]) {
    assert!(width.is_multiple_of(WIDTH) && b.len() >= depth * width && c.len() >= rows * width);
    if rows == 0 || depth == 0 {
        return;
    }
    assert!(a.values.len() > (rows - 1) * a.steps[0] + (depth - 1) * a.steps[1]);
    let task = Task { rows, depth, width, a: a.values.as_ptr(), steps: a.steps, b: b.as_ptr(), c: c.as_mut_ptr() };
    // The lengths were checked above, the features are checked here.
    unsafe { run(&task) }
}

struct Task {
    rows: usize,
    depth: usize,
    width: usize,
    a: *const f32,
    steps: [usize; 2],
    b: *const f32,
    c: *mut f32,
}

unsafe fn run(task: &Task) {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") {
            return unsafe { run_avx512(task) };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return unsafe { run_avx2(task) };
        }
    }
    #[cfg(target_arch = "aarch64")]
    return unsafe { blocks::<super::simd::arm::Neon>(task) };
    #[cfg(not(target_arch = "aarch64"))]
    unsafe {
        run_plain(task)
    }
}

#[cfg_attr(target_arch = "aarch64", allow(dead_code))]
unsafe fn run_plain(task: &Task) {
    unsafe { blocks::<Plain>(task) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn run_avx512(task: &Task) {
    unsafe { blocks::<super::simd::x86::Avx512>(task) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn run_avx2(task: &Task) {
    unsafe { blocks::<super::simd::x86::Avx2>(task) }
}

/// Cuts C into blocks whose sums fit into the registers.
#[inline(always)]
unsafe fn blocks<V: Wide>(task: &Task) {
    let columns = task.width / WIDTH;
    let mut column = 0;
    // Four columns of sixteen numbers only where there are registers for six rows of them.
    while V::ROWS >= 6 && column + 4 <= columns {
        unsafe { rows::<V, 4>(task, column * WIDTH) };
        column += 4;
    }
    while column + 2 <= columns {
        unsafe { rows::<V, 2>(task, column * WIDTH) };
        column += 2;
    }
    if column < columns {
        unsafe { rows::<V, 1>(task, column * WIDTH) };
    }
}

#[inline(always)]
unsafe fn rows<V: Wide, const COLUMNS: usize>(task: &Task, column: usize) {
    let mut row = 0;
    if COLUMNS == 1 {
        while row + 8 <= task.rows {
            unsafe { block::<V, 8, COLUMNS>(task, row, column) };
            row += 8;
        }
    }
    while V::ROWS >= 6 && row + 6 <= task.rows {
        unsafe { block::<V, 6, COLUMNS>(task, row, column) };
        row += 6;
    }
    while V::ROWS >= 3 && row + 3 <= task.rows {
        unsafe { block::<V, 3, COLUMNS>(task, row, column) };
        row += 3;
    }
    while row < task.rows {
        unsafe { block::<V, 1, COLUMNS>(task, row, column) };
        row += 1;
    }
}

#[inline(always)]
unsafe fn block<V: Wide, const ROWS: usize, const COLUMNS: usize>(task: &Task, row: usize, column: usize) {
    unsafe {
        let mut sums = [[V::splat(0.0); COLUMNS]; ROWS];
        let c = task.c.add(row * task.width + column);
        for i in 0..ROWS {
            for j in 0..COLUMNS {
                sums[i][j] = V::load(c.add(i * task.width + j * WIDTH));
            }
        }
        let mut a = task.a.add(row * task.steps[0]);
        let mut b = task.b.add(column);
        for _ in 0..task.depth {
            let mut wide = [V::splat(0.0); COLUMNS];
            for j in 0..COLUMNS {
                wide[j] = V::load(b.add(j * WIDTH));
            }
            for i in 0..ROWS {
                let factor = V::splat(*a.add(i * task.steps[0]));
                for j in 0..COLUMNS {
                    sums[i][j] = sums[i][j].fused(factor, wide[j]);
                }
            }
            a = a.add(task.steps[1]);
            b = b.add(task.width);
        }
        for i in 0..ROWS {
            for j in 0..COLUMNS {
                sums[i][j].store(c.add(i * task.width + j * WIDTH));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::random::Xoshiro256PlusPlus;

    /// The definition, in the same order.
    fn chain(rows: usize, depth: usize, width: usize, a: StridedMatrix, b: &[f32], c: &mut [f32]) {
        for i in 0..rows {
            for j in 0..width {
                for k in 0..depth {
                    let sum = &mut c[i * width + j];
                    *sum = a.values[i * a.steps[0] + k * a.steps[1]].mul_add(b[k * width + j], *sum);
                }
            }
        }
    }

    #[test]
    fn every_register_gives_the_bits_of_the_definition() {
        let mut random = Xoshiro256PlusPlus::new(7);
        let mut numbers = |count: usize| (0..count).map(|_| random.normal()).collect::<Vec<f32>>();
        for (rows, depth, width) in [(1, 1, 16), (5, 3, 16), (9, 48, 64), (23, 17, 80), (13, 64, 112), (3, 5, 32)] {
            let (a, b, start) = (numbers(rows * depth), numbers(depth * width), numbers(rows * width));
            for steps in [[depth, 1], [1, rows]] {
                let a = StridedMatrix { values: &a, steps };
                let mut expected = start.clone();
                chain(rows, depth, width, a, &b, &mut expected);
                let mut found = start.clone();
                add_product(rows, depth, width, a, &b, &mut found);
                assert_eq!(found, expected, "{rows} x {depth} x {width}");
                let mut plain = start.clone();
                let (pa, pb, pc) = (a.values.as_ptr(), b.as_ptr(), plain.as_mut_ptr());
                unsafe { run_plain(&Task { rows, depth, width, a: pa, steps, b: pb, c: pc }) };
                assert_eq!(plain, expected, "{rows} x {depth} x {width} without vector registers");
                #[cfg(target_arch = "x86_64")]
                if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                    let mut narrow = start.clone();
                    let pc = narrow.as_mut_ptr();
                    unsafe { run_avx2(&Task { rows, depth, width, a: pa, steps, b: pb, c: pc }) };
                    assert_eq!(narrow, expected, "{rows} x {depth} x {width} with AVX2");
                }
            }
        }
    }
}
