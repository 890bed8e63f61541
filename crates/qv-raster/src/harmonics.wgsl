// Twin of harmonics.rs: the sum of basis functions times coefficients, and its gradient.

const C0: f32 = 0.28209479;
const C1: f32 = 0.48860251;
const C2: vec3<f32> = vec3<f32>(1.0925484, 0.31539157, 0.5462742);
const C3: array<f32, 5> = array<f32, 5>(0.5900436, 2.8906114, 0.4570458, 0.37317634, 1.4453057);

fn coefficient(splat: u32, k: u32) -> vec3<f32> {
    let at = 3u * (splat * SH_COUNT + k);
    return vec3<f32>(sh[at], sh[at + 1u], sh[at + 2u]);
}

// Colour before it is cut off at 0.
fn colour_of(splat: u32, d: vec3<f32>) -> vec3<f32> {
    var sum = vec3<f32>(0.5) + C0 * coefficient(splat, 0u);
    if SH_COUNT < 4u {
        return sum;
    }
    sum += -C1 * d.y * coefficient(splat, 1u) + C1 * d.z * coefficient(splat, 2u) - C1 * d.x * coefficient(splat, 3u);
    if SH_COUNT < 9u {
        return sum;
    }
    let s = d * d;
    sum += C2.x * d.x * d.y * coefficient(splat, 4u);
    sum += -C2.x * d.y * d.z * coefficient(splat, 5u);
    sum += C2.y * (2.0 * s.z - s.x - s.y) * coefficient(splat, 6u);
    sum += -C2.x * d.x * d.z * coefficient(splat, 7u);
    sum += C2.z * (s.x - s.y) * coefficient(splat, 8u);
    if SH_COUNT < 16u {
        return sum;
    }
    sum += -C3[0] * d.y * (3.0 * s.x - s.y) * coefficient(splat, 9u);
    sum += C3[1] * d.x * d.y * d.z * coefficient(splat, 10u);
    sum += -C3[2] * d.y * (4.0 * s.z - s.x - s.y) * coefficient(splat, 11u);
    sum += C3[3] * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y) * coefficient(splat, 12u);
    sum += -C3[2] * d.x * (4.0 * s.z - s.x - s.y) * coefficient(splat, 13u);
    sum += C3[4] * d.z * (s.x - s.y) * coefficient(splat, 14u);
    sum += -C3[0] * d.x * (s.x - 3.0 * s.y) * coefficient(splat, 15u);
    return sum;
}
