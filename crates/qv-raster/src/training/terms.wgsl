// Twins of terms/priors.rs, terms/depth_normal.rs and terms/multi_view.rs: an invocation for each pixel, which gathers what comes to it.
// `planes` sets the derivatives by normal and plane depth and keeps the plane depth for views that come later; `consistent` adds to them;
// `prior` sets those by mean depth.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(1) var<storage, read> drawn: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> photograph: array<u32>;
// Normal and plane depth.
@group(0) @binding(3) var<storage, read> plane_image: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> by_planes: array<vec4<f32>>;
// Four vectors for each photograph: focal lengths and centre first.
@group(0) @binding(5) var<storage, read> lenses: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> motions: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> own_depths: array<f32>;
@group(0) @binding(8) var<storage, read> other_depths: array<f32>;
@group(0) @binding(9) var<storage, read> other_photograph: array<u32>;
@group(0) @binding(10) var<storage, read> depths: array<f32>;
@group(0) @binding(11) var<storage, read_write> by_depths: array<f32>;
@group(0) @binding(12) var<storage, read> measured: array<f32>;
@group(0) @binding(14) var<storage, read> features: array<f32>;
@group(0) @binding(15) var<storage, read_write> by_features: array<f32>;
// 0 for none, then 1 + the label.
@group(0) @binding(16) var<storage, read> label_image: array<u32>;

const SMOOTH: f32 = 0.1;
const SHORT: f32 = 0.3;
const SOLID: f32 = 0.5;
const REACH: i32 = 3;
const COUNT: f32 = 49.0;
const STRIDE: u32 = 3u;
const FLAT: f32 = 1e-4;
const UNLIKE: f32 = 0.9;
const HIDDEN: f32 = 0.05;

fn ray(x: i32, y: i32) -> vec3<f32> {
    let lens = lenses[4u * step.photograph];
    return vec3<f32>((vec2<f32>(f32(x), f32(y)) + 0.5 - lens.zw) / lens.xy, 1.0);
}

fn index(x: i32, y: i32) -> u32 {
    return u32(y) * step.width + u32(x);
}

fn depth_at(x: i32, y: i32) -> f32 {
    return plane_image[index(x, y)].w;
}

struct Surface {
    good: bool,
    normal: vec3<f32>,
    across: vec3<f32>,
    down: vec3<f32>,
    area: f32,
}

fn surface(x: i32, y: i32) -> Surface {
    var s: Surface;
    if x < 1 || y < 1 || x + 1 >= i32(step.width) || y + 1 >= i32(step.height) {
        return s;
    }
    let here = depth_at(x, y);
    let around = vec4<f32>(depth_at(x + 1, y), depth_at(x - 1, y), depth_at(x, y + 1), depth_at(x, y - 1));
    if here <= 0.0 || any(around <= vec4<f32>(0.0)) || any(abs(around - here) > vec4<f32>(SMOOTH * here)) {
        return s;
    }
    s.across = ray(x + 1, y) * around.x - ray(x - 1, y) * around.y;
    s.down = ray(x, y + 1) * around.z - ray(x, y - 1) * around.w;
    let product = cross(s.down, s.across);
    s.area = length(product);
    s.good = s.area > 0.0;
    s.normal = product / s.area;
    return s;
}

// Direction of the drawn normal; 0 where it says nothing.
fn normal_at(x: i32, y: i32) -> vec3<f32> {
    let normal = plane_image[index(x, y)].xyz;
    let size = length(normal);
    return select(vec3<f32>(0.0), normal / size, size > SHORT);
}

fn by_product(s: Surface, x: i32, y: i32) -> vec3<f32> {
    let drawn = normal_at(x, y);
    return (drawn - s.normal * dot(drawn, s.normal)) * (-step.depth_normal / s.area);
}

@compute @workgroup_size(256)
fn planes(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let x = i32(16u * group.x + local % 16u);
    let y = i32(16u * group.y + local / 16u);
    if x >= i32(step.width) || y >= i32(step.height) {
        return;
    }
    let pixel = index(x, y);
    own_depths[pixel] = plane_image[pixel].w;
    var by = vec4<f32>(0.0);
    if step.depth_normal > 0.0 {
        let here = surface(x, y);
        if here.good {
            let drawn = normal_at(x, y);
            let turn = here.normal * dot(drawn, drawn) - drawn * dot(drawn, here.normal);
            by = vec4<f32>(turn * (-step.depth_normal / max(length(plane_image[pixel].xyz), SHORT)), 0.0);
        }
        var by_point = vec3<f32>(0.0);
        let left = surface(x - 1, y);
        if left.good {
            by_point += cross(by_product(left, x - 1, y), left.down);
        }
        let right = surface(x + 1, y);
        if right.good {
            by_point -= cross(by_product(right, x + 1, y), right.down);
        }
        let above = surface(x, y - 1);
        if above.good {
            by_point += cross(above.across, by_product(above, x, y - 1));
        }
        let below = surface(x, y + 1);
        if below.good {
            by_point -= cross(below.across, by_product(below, x, y + 1));
        }
        by.w = dot(by_point, ray(x, y));
    }
    by_planes[pixel] = by;
}

fn grey_of(word: u32) -> f32 {
    let bytes = vec3<u32>(word & 0xffu, (word >> 8u) & 0xffu, (word >> 16u) & 0xffu);
    return f32(bytes.x + bytes.y + bytes.z) * (1.0 / 765.0);
}

fn row(motion: u32, k: u32) -> vec4<f32> {
    return motions[3u * motion + k];
}

struct Spot {
    good: bool,
    here: f32,
    found: f32,
    by_depth: f32,
    by_normal: vec3<f32>,
}

@compute @workgroup_size(256)
fn consistent(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let x = i32(step.from_x + STRIDE * (16u * group.x + local % 16u));
    let y = i32(step.from_y + STRIDE * (16u * group.y + local / 16u));
    if x < REACH || y < REACH || x + REACH >= i32(step.width) || y + REACH >= i32(step.height) {
        return;
    }
    let pixel = index(x, y);
    let normal = plane_image[pixel].xyz;
    let depth = plane_image[pixel].w;
    let centre = ray(x, y);
    let facing = dot(normal, centre);
    if depth <= 0.0 || facing > -1e-3 {
        return;
    }
    // other_from_world times world_from_this.
    let a = transpose(mat3x3<f32>(row(step.photograph, 0u).xyz, row(step.photograph, 1u).xyz, row(step.photograph, 2u).xyz));
    let b = transpose(mat3x3<f32>(row(step.partner, 0u).xyz, row(step.partner, 1u).xyz, row(step.partner, 2u).xyz));
    let own = vec3<f32>(row(step.photograph, 0u).w, row(step.photograph, 1u).w, row(step.photograph, 2u).w);
    let theirs = vec3<f32>(row(step.partner, 0u).w, row(step.partner, 1u).w, row(step.partner, 2u).w);
    let rotation = b * transpose(a);
    let shift = theirs - rotation * own;
    let lens = lenses[4u * step.partner];
    let size = vec2<i32>(i32(step.partner_width), i32(step.partner_height));
    let seen = rotation * (centre * depth) + shift;
    if seen.z <= 0.0 {
        return;
    }
    let at = lens.xy * seen.xy / seen.z + lens.zw;
    if !(all(at >= vec2<f32>(0.0)) && all(at < vec2<f32>(size))) {
        return;
    }
    let there = other_depths[u32(at.y) * step.partner_width + u32(at.x)];
    if abs(there - seen.z) > HIDDEN * seen.z {
        return;
    }
    var sums = array<f32, 5>();
    var mean_here = 0.0;
    var mean_found = 0.0;
    var norm = 0.0;
    var ncc = 0.0;
    var variance = 1.0;
    var out_normal = vec3<f32>(0.0);
    var out_depth = 0.0;
    // The first round sums up what NCC is made of, the second its derivatives.
    for (var round = 0u; round < 2u; round++) {
        for (var k = 0; k < 49; k++) {
            let u = x + k % 7 - REACH;
            let v = y + k / 7 - REACH;
            let r = ray(u, v);
            let along = dot(normal, r);
            if along > -1e-3 {
                return;
            }
            let ratio = facing / along;
            let p = rotation * (r * (depth * ratio)) + shift;
            if p.z <= 0.0 {
                return;
            }
            let corner = lens.xy * p.xy / p.z + lens.zw - 0.5;
            if !(all(corner >= vec2<f32>(0.0)) && all(corner < vec2<f32>(size - 1))) {
                return;
            }
            let first = vec2<u32>(corner);
            let f = corner - floor(corner);
            let word = first.y * step.partner_width + first.x;
            let p00 = grey_of(other_photograph[word]);
            let p10 = grey_of(other_photograph[word + 1u]);
            let p01 = grey_of(other_photograph[word + step.partner_width]);
            let p11 = grey_of(other_photograph[word + step.partner_width + 1u]);
            let top = p00 + f.x * (p10 - p00);
            let bottom = p01 + f.x * (p11 - p01);
            let found = top + f.y * (bottom - top);
            let here = grey_of(photograph[index(u, v)]);
            if round == 0u {
                sums[0] += here;
                sums[1] += found;
                sums[2] += here * here;
                sums[3] += found * found;
                sums[4] += here * found;
            } else {
                let slope = vec2<f32>((p10 - p00) + f.y * ((p11 - p01) - (p10 - p00)), bottom - top);
                let w = slope * lens.xy / p.z;
                let by_point = transpose(rotation) * vec3<f32>(w, -dot(w, p.xy) / p.z);
                let along_ray = dot(by_point, r);
                let by = -((here - mean_here) * norm - ncc * (found - mean_found) / variance) / COUNT;
                out_depth += by * along_ray * ratio;
                out_normal += (by * along_ray * depth / along) * (centre - r * ratio);
            }
        }
        if round == 0u {
            mean_here = sums[0] / COUNT;
            mean_found = sums[1] / COUNT;
            let own_variance = max(sums[2] / COUNT - mean_here * mean_here, 0.0) + FLAT;
            variance = max(sums[3] / COUNT - mean_found * mean_found, 0.0) + FLAT;
            norm = 1.0 / sqrt(own_variance * variance);
            ncc = (sums[4] / COUNT - mean_here * mean_found) * norm;
            if 1.0 - ncc >= UNLIKE {
                return;
            }
        }
    }
    by_planes[pixel] += step.multi_view * vec4<f32>(out_normal, out_depth);
}

@compute @workgroup_size(256)
fn prior(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let x = i32(16u * group.x + local % 16u);
    let y = i32(16u * group.y + local / 16u);
    if x >= i32(step.width) || y >= i32(step.height) {
        return;
    }
    let pixel = index(x, y);
    var by = 0.0;
    if measured[pixel] > 0.0 && drawn[pixel].w >= SOLID && (photograph[pixel] >> 24u) != 0u {
        by = step.depth_prior * select(-1.0, 1.0, depths[pixel] >= measured[pixel]) / measured[pixel];
    }
    by_depths[pixel] = by;
}

@compute @workgroup_size(256)
fn labels(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let x = i32(16u * group.x + local % 16u);
    let y = i32(16u * group.y + local / 16u);
    if x >= i32(step.width) || y >= i32(step.height) {
        return;
    }
    let pixel = index(x, y);
    let first = pixel * step.feature_count;
    let label = (label_image[pixel / 4u] >> (8u * (pixel % 4u))) & 0xffu;
    let counts = label <= step.feature_count && (photograph[pixel] >> 24u) != 0u;
    var most = features[first];
    for (var k = 1u; k < step.feature_count; k++) {
        most = max(most, features[first + k]);
    }
    var sum = 0.0;
    for (var k = 0u; k < step.feature_count; k++) {
        sum += exp(features[first + k] - most);
    }
    for (var k = 0u; k < step.feature_count; k++) {
        // None of them (0) is to look like no label more than like another.
        let wanted = select(select(0.0, 1.0, k + 1u == label), 1.0 / f32(step.feature_count), label == 0u);
        by_features[first + k] = select(0.0, step.labels * (exp(features[first + k] - most) / sum - wanted), counts);
    }
}
