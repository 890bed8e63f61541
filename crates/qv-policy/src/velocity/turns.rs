//! Quaternions and vectors in single precision, for many robots at once.

/// Cosine and sine of the heading of a quaternion w, x, y, z.
pub(super) fn heading([w, x, y, z]: [f32; 4]) -> [f32; 2] {
    let (c, s) = (1.0 - 2.0 * (y * y + z * z), 2.0 * (w * z + x * y));
    let length = c.hypot(s).max(1e-6);
    [c / length, s / length]
}

/// A vector in the axes of the heading of a quaternion: forwards, to the left, up.
pub(crate) fn in_heading(turn: [f32; 4], v: [f32; 3]) -> [f32; 3] {
    let [c, s] = heading(turn);
    [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]]
}

/// A vector turned by a quaternion w, x, y, z.
pub(super) fn turned([w, x, y, z]: [f32; 4], v: [f32; 3]) -> [f32; 3] {
    let t = [2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])];
    [
        v[0] + w * t[0] + y * t[2] - z * t[1],
        v[1] + w * t[1] + z * t[0] - x * t[2],
        v[2] + w * t[2] + x * t[1] - y * t[0],
    ]
}

/// A vector turned by the inverse of a quaternion.
pub(super) fn turned_back([w, x, y, z]: [f32; 4], v: [f32; 3]) -> [f32; 3] {
    turned([w, -x, -y, -z], v)
}
