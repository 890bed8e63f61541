//! States of joints as messages of ROS.

use qv_recording::cdr::Writer;

pub(super) fn row(values: &[f64], i: usize, n: usize) -> &[f64] {
    values.get(i * n..(i + 1) * n).unwrap_or(&[])
}

pub(super) fn joint_state_bytes(stamp: u64, names: &[String], states: [&[f64]; 3]) -> Vec<u8> {
    let mut w = Writer::new();
    w.time(stamp).string("").u32(names.len() as u32);
    names.iter().for_each(|n| {
        w.string(n);
    });
    for values in states {
        w.f64_sequence(values);
    }
    w.finish()
}
