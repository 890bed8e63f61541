// The geometry that project.rs keeps in `Shape`.

struct Shape {
    good: bool,
    centre: vec3<f32>,
    axes: mat3x3<f32>,
    length: f32,
    scales: vec3<f32>,
    spread: mat3x3<f32>,
    rotation: mat3x3<f32>,
    slope: vec2<f32>,
    row_x: vec3<f32>,
    row_y: vec3<f32>,
    covariance: vec3<f32>,
    determinant: f32,
//#if ANTIALIAS
    area: vec3<f32>,
    // Share of the opacity that is kept.
    kept: f32,
//#endif
    shortest: u32,
}

fn axes_of(q: vec4<f32>) -> mat3x3<f32> {
    let w = q.x;
    let v = q.yzw;
    return mat3x3<f32>(
        1.0 - 2.0 * (v.y * v.y + v.z * v.z), 2.0 * (v.x * v.y + w * v.z), 2.0 * (v.x * v.z - w * v.y),
        2.0 * (v.x * v.y - w * v.z), 1.0 - 2.0 * (v.x * v.x + v.z * v.z), 2.0 * (v.y * v.z + w * v.x),
        2.0 * (v.x * v.z + w * v.y), 2.0 * (v.y * v.z - w * v.x), 1.0 - 2.0 * (v.x * v.x + v.y * v.y),
    );
}

fn shape_of(lens: Lens, m: Motion, mean: vec3<f32>, log_scales: vec3<f32>, quaternion: vec4<f32>) -> Shape {
    var s: Shape;
    let square = dot(quaternion, quaternion);
    s.good = finite(square) && square >= MIN_QUATERNION;
    s.length = sqrt(square);
    s.axes = axes_of(quaternion / s.length);
    s.scales = exp(log_scales);
    s.rotation = transpose(mat3x3<f32>(m.x.xyz, m.y.xyz, m.z.xyz));
    s.spread = s.rotation * mat3x3<f32>(s.axes[0] * s.scales.x, s.axes[1] * s.scales.y, s.axes[2] * s.scales.z);
    let point = vec4<f32>(mean, 1.0);
    s.centre = vec3<f32>(dot(m.x, point), dot(m.y, point), dot(m.z, point));
    s.slope = clamp(s.centre.xy / s.centre.z, lens.lowest, lens.highest);
    let by_row = transpose(s.spread);
    s.row_x = (lens.focal.x / s.centre.z) * (by_row[0] - s.slope.x * by_row[2]);
    s.row_y = (lens.focal.y / s.centre.z) * (by_row[1] - s.slope.y * by_row[2]);
    let xx = dot(s.row_x, s.row_x);
    let yy = dot(s.row_y, s.row_y);
    let area = cross(s.row_x, s.row_y);
    s.determinant = dot(area, area) + LOW_PASS * (xx + yy) + LOW_PASS * LOW_PASS;
//#if ANTIALIAS
    s.area = area;
    s.kept = length(area) / sqrt(s.determinant);
//#endif
    s.covariance = vec3<f32>(xx + LOW_PASS, dot(s.row_x, s.row_y), yy + LOW_PASS);
    s.shortest = 2u;
    if s.scales.x <= s.scales.y && s.scales.x <= s.scales.z {
        s.shortest = 0u;
    } else if s.scales.y <= s.scales.z {
        s.shortest = 1u;
    }
    return s;
}

// u00, u01, u11.
fn factor_of(s: Shape) -> vec3<f32> {
    let u00 = sqrt(s.covariance.z / s.determinant);
    return vec3<f32>(u00, -(s.covariance.y / s.covariance.z) * u00, 1.0 / sqrt(s.covariance.z));
}

// Unit normal towards the camera, and the sign that turned it there.
fn normal_of(s: Shape) -> vec4<f32> {
    var axis = s.axes[2];
    if s.shortest == 0u {
        axis = s.axes[0];
    } else if s.shortest == 1u {
        axis = s.axes[1];
    }
    let normal = s.rotation * axis;
    let turn = select(1.0, -1.0, dot(normal, s.centre) > 0.0);
    return vec4<f32>(normal * turn, turn);
}
