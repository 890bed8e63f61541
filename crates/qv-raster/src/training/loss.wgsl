// Twin of loss.rs and exposure.rs: a workgroup for each 16 x 16 pixels, an invocation for each pixel. `similar` gives the derivatives of
// SSIM by the means of its windows, `pull` the derivative of the loss by the drawn colour.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(1) var<storage, read> drawn: array<vec4<f32>>;
// Bytes red, green, blue, and 0 where there is no photograph.
@group(0) @binding(2) var<storage, read> photograph: array<u32>;
// Each exposure is followed by its running means.
@group(0) @binding(3) var<storage, read> exposures: array<f32>;
// Derivatives by the means of x, xx, xy, for each colour one image after the other.
@group(0) @binding(4) var<storage, read_write> maps: array<f32>;
@group(0) @binding(5) var<storage, read_write> by_drawn: array<vec4<f32>>;
// Of each workgroup: 12 derivatives by the exposure, sums of distances and of 1 - SSIM, two that are free.
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

const SIDE: u32 = 26u;
const ROWS: u32 = 416u;
const C1: f32 = 1e-4;
const C2: f32 = 9e-4;

var<workgroup> xs: array<f32, 676>;
var<workgroup> ys: array<f32, 676>;
var<workgroup> zs: array<f32, 676>;
var<workgroup> rows: array<f32, 2080>;
var<workgroup> parts: array<f32, 256>;

fn exposed(colour: vec3<f32>) -> vec3<f32> {
    if step.exposes == 0u {
        return colour;
    }
    let e = 36u * step.photograph;
    return vec3<f32>(
        exposures[e] * colour.x + exposures[e + 1u] * colour.y + exposures[e + 2u] * colour.z + exposures[e + 3u],
        exposures[e + 4u] * colour.x + exposures[e + 5u] * colour.y + exposures[e + 6u] * colour.z + exposures[e + 7u],
        exposures[e + 8u] * colour.x + exposures[e + 9u] * colour.y + exposures[e + 10u] * colour.z + exposures[e + 11u],
    );
}

fn wanted_at(pixel: u32) -> vec4<f32> {
    return unpack4x8unorm(photograph[pixel]);
}

// The pixel of a place in the square around a tile, and whether it is in the image.
fn around(tile: vec2<u32>, place: u32) -> vec3<u32> {
    let at = vec2<i32>(tile * 16u) + vec2<i32>(i32(place % SIDE), i32(place / SIDE)) - 5;
    let inside = at.x >= 0 && at.y >= 0 && at.x < i32(step.width) && at.y < i32(step.height);
    return vec3<u32>(vec2<u32>(max(at, vec2<i32>(0))), select(0u, 1u, inside));
}

// Sum over the workgroup, for invocation 0.
fn total(value: f32, local: u32) -> f32 {
    workgroupBarrier();
    parts[local] = value;
    workgroupBarrier();
    if local < 16u {
        var sum = 0.0;
        for (var k = 0u; k < 16u; k++) {
            sum += parts[16u * k + local];
        }
        parts[local] = sum;
    }
    workgroupBarrier();
    var sum = 0.0;
    if local == 0u {
        for (var k = 0u; k < 16u; k++) {
            sum += parts[k];
        }
    }
    return sum;
}

@compute @workgroup_size(256)
fn similar(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let x = local % 16u;
    let y = local / 16u;
    let inside = 16u * group.x + x < step.width && 16u * group.y + y < step.height;
    let pixel = (16u * group.y + y) * step.width + 16u * group.x + x;
    let pixels = step.width * step.height;
    var lost = 0.0;
    for (var c = 0u; c < 3u; c++) {
        for (var place = local; place < 676u; place += 256u) {
            let at = around(group.xy, place);
            var a = 0.0;
            var b = 0.0;
            if at.z != 0u {
                let there = at.y * step.width + at.x;
                let wanted = wanted_at(there);
                b = wanted[c];
                a = select(b, exposed(drawn[there].xyz)[c], wanted.w > 0.0);
            }
            xs[place] = a;
            ys[place] = b;
        }
        workgroupBarrier();
        for (var place = local; place < ROWS; place += 256u) {
            let first = place / 16u * SIDE + place % 16u;
            var m = array<f32, 5>();
//#taps
            {
                let a = xs[first + $K];
                let b = ys[first + $K];
                m[0] += $W * a;
                m[1] += $W * b;
                m[2] += $W * (a * a);
                m[3] += $W * (b * b);
                m[4] += $W * (a * b);
            }
//#end
            rows[place] = m[0];
            rows[ROWS + place] = m[1];
            rows[2u * ROWS + place] = m[2];
            rows[3u * ROWS + place] = m[3];
            rows[4u * ROWS + place] = m[4];
        }
        workgroupBarrier();
        var mx = 0.0;
        var my = 0.0;
        var mxx = 0.0;
        var myy = 0.0;
        var mxy = 0.0;
//#taps
        {
            let place = local + 16u * $K;
            mx += $W * rows[place];
            my += $W * rows[ROWS + place];
            mxx += $W * rows[2u * ROWS + place];
            myy += $W * rows[3u * ROWS + place];
            mxy += $W * rows[4u * ROWS + place];
        }
//#end
        if inside {
            let a = 2.0 * mx * my + C1;
            let b = 2.0 * (mxy - mx * my) + C2;
            let e = mx * mx + my * my + C1;
            let d = (mxx - mx * mx) + (myy - my * my) + C2;
            let whole = a * b / (e * d);
            let by_xx = -whole / d;
            let by_xy = 2.0 * a / (e * d);
            maps[3u * c * pixels + pixel] = 2.0 * my * b / (e * d) - 2.0 * mx * whole / e - 2.0 * mx * by_xx - my * by_xy;
            maps[(3u * c + 1u) * pixels + pixel] = by_xx;
            maps[(3u * c + 2u) * pixels + pixel] = by_xy;
            lost += 1.0 - whole;
        }
    }
    let all = total(lost, local);
    if local == 0u {
        sums[16u * (group.y * ((step.width + 15u) / 16u) + group.x) + 13u] = all;
    }
}

@compute @workgroup_size(256)
fn pull(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let x = local % 16u;
    let y = local / 16u;
    let inside = 16u * group.x + x < step.width && 16u * group.y + y < step.height;
    let pixel = (16u * group.y + y) * step.width + 16u * group.x + x;
    let pixels = step.width * step.height;
    var colour = vec3<f32>(0.0);
    var seen = vec3<f32>(0.0);
    var wanted = vec4<f32>(0.0);
    if inside {
        colour = drawn[pixel].xyz;
        seen = exposed(colour);
        wanted = wanted_at(pixel);
    }
    var by = vec3<f32>(0.0);
    for (var c = 0u; c < 3u; c++) {
        for (var place = local; place < 676u; place += 256u) {
            let at = around(group.xy, place);
            let there = at.y * step.width + at.x;
            var m = vec3<f32>(0.0);
            if at.z != 0u {
                m.x = maps[3u * c * pixels + there];
                m.y = maps[(3u * c + 1u) * pixels + there];
                m.z = maps[(3u * c + 2u) * pixels + there];
            }
            xs[place] = m.x;
            ys[place] = m.y;
            zs[place] = m.z;
        }
        workgroupBarrier();
        for (var place = local; place < ROWS; place += 256u) {
            let first = place / 16u * SIDE + place % 16u;
            var m = vec3<f32>(0.0);
//#taps
            m += $W * vec3<f32>(xs[first + $K], ys[first + $K], zs[first + $K]);
//#end
            rows[place] = m.x;
            rows[ROWS + place] = m.y;
            rows[2u * ROWS + place] = m.z;
        }
        workgroupBarrier();
        var m = vec3<f32>(0.0);
//#taps
        {
            let place = local + 16u * $K;
            m += $W * vec3<f32>(rows[place], rows[ROWS + place], rows[2u * ROWS + place]);
        }
//#end
        by[c] = -step.ssim * step.pixel * (m.x + 2.0 * seen[c] * m.y + wanted[c] * m.z);
    }
    let apart = seen - wanted.xyz;
    var far = 0.0;
    if inside && wanted.w > 0.0 {
        by += (1.0 - step.ssim) * step.pixel * sign(apart);
        far = abs(apart.x) + abs(apart.y) + abs(apart.z);
    } else {
        by = vec3<f32>(0.0);
    }
    let to = 16u * (group.y * ((step.width + 15u) / 16u) + group.x);
    let all_far = total(far, local);
    if local == 0u {
        sums[to + 12u] = all_far;
    }
    if step.exposes != 0u {
        for (var k = 0u; k < 12u; k++) {
            let row = k / 4u;
            let column = k % 4u;
            let part = by[row] * select(1.0, colour[min(column, 2u)], column < 3u);
            let all = total(part, local);
            if local == 0u {
                sums[to + k] = all;
            }
        }
        let e = 36u * step.photograph;
        by = vec3<f32>(
            exposures[e] * by.x + exposures[e + 4u] * by.y + exposures[e + 8u] * by.z,
            exposures[e + 1u] * by.x + exposures[e + 5u] * by.y + exposures[e + 9u] * by.z,
            exposures[e + 2u] * by.x + exposures[e + 6u] * by.y + exposures[e + 10u] * by.z,
        );
    }
    if inside {
        by_drawn[pixel] = vec4<f32>(by, 0.0);
    }
}
