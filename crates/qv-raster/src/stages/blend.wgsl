// Twin of blend.rs and of resolve: a workgroup for each tile, an invocation for each pixel. With subgroups, each of them holds a small
// block of pixels, tests that block against the ellipses of as many Gaussians as it has lanes, and walks those that it touches.

@group(0) @binding(0) var<storage, read> lenses: array<Lens>;
@group(0) @binding(1) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> sorted: array<u32>;
@group(0) @binding(4) var<storage, read> look: Look;
//#if BYTES
@group(0) @binding(5) var<storage, read_write> colours: array<u32>;
//#else
@group(0) @binding(5) var<storage, read_write> colours: array<vec4<f32>>;
//#endif
//#if DEPTH
@group(0) @binding(6) var<storage, read_write> depths: array<f32>;
//#endif
//#if PLANE
@group(0) @binding(7) var<storage, read> planes: array<vec4<f32>>;
// Normal, then plane depth.
@group(0) @binding(8) var<storage, read_write> plane_image: array<vec4<f32>>;
//#endif
//#if FEATURES
@group(0) @binding(9) var<storage, read> features: array<f32>;
@group(0) @binding(10) var<storage, read_write> feature_image: array<f32>;
//#endif
//#if KEEP
@group(0) @binding(11) var<storage, read> owners: array<u32>;
// Transmittance that is left, and one past the last sorted entry that was taken.
@group(0) @binding(12) var<storage, read_write> left_image: array<vec2<u32>>;
//#endif

//#if PACKED
//#else
@group(0) @binding(13) var<storage, read> shades: array<vec4<f32>>;
//#endif

struct Look {
    background: vec4<f32>,
}

// Mean and u00, u01, with U scaled so that opacity falls with exp2(-|U d|²).
var<workgroup> as_: array<vec4<f32>, 256>;
//#if PACKED
// u11, opacity, red and green in half precision, blue.
var<workgroup> bs: array<vec4<f32>, 256>;
//#if DEPTH
var<workgroup> ds: array<f32, 256>;
//#endif
//#else
// u11, opacity, view, Gaussian; colour, depth.
var<workgroup> bs: array<vec4<f32>, 256>;
var<workgroup> cs: array<vec4<f32>, 256>;
//#endif
//#if SUBGROUPS
// For each block of pixels, which of a batch touch it, a word for each subgroup that loaded them.
var<workgroup> touching: array<u32, SUBGROUP_COUNT * SUBGROUP_COUNT>;
//#endif
// Pixels that take no more.
var<workgroup> closed: atomic<u32>;
var<workgroup> all_closed: u32;
//#if PLANE
var<workgroup> ps: array<vec4<f32>, 256>;
//#endif

const CLOSED: f32 = 2.0;

@compute @workgroup_size(256)
fn blend(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
//#if SUBGROUPS
    @builtin(subgroup_invocation_id) lane: u32,
    @builtin(subgroup_id) subgroup: u32,
//#endif
) {
    let view = group.y;
    let size = lenses[view].size;
    let across = lenses[view].tiles;
    if group.x >= across.x * across.y {
        return;
    }
    let tile = lenses[view].first_tile + group.x;
    let x = group.x % across.x * TILE + squeeze(local);
    let y = group.x / across.x * TILE + squeeze(local >> 1u);
    let inside = x < size.x && y < size.y;
    let at = vec2<f32>(f32(x), f32(y)) + 0.5;
    if local == 0u {
        atomicStore(&closed, 0u);
        all_closed = 0u;
    }
//#if SUBGROUPS
    let own_block = block_of(x % TILE, y % TILE);
    let corner = vec2<f32>(f32(group.x % across.x * TILE), f32(group.x / across.x * TILE)) + 0.5;
//#endif
    workgroupBarrier();
    // Least opacity that counts: beyond any once the pixel takes no more.
    var least = select(CLOSED, MIN_ALPHA, inside);
    var counted = false;
    var left = 1.0;
    var colour = vec3<f32>(0.0);
//#if DEPTH
    var depth = 0.0;
//#endif
//#if PLANE
    var plane = vec4<f32>(0.0);
//#endif
//#if FEATURES
    var sums: array<f32, FEATURE_COUNT>;
//#endif
//#if KEEP
    var last = 0u;
//#endif
    let range = ranges[tile];
    for (var start = range.x; start < range.y; start += 256u) {
//#if SUBGROUPS
        var blocks = 0u;
//#endif
        if start + local < range.y {
//#if KEEP
            let record = owners[sorted[start + local]];
//#else
            let record = sorted[start + local];
//#endif
            var a = records[2u * record];
            var b = records[2u * record + 1u];
            a.z *= TO_EXP2;
            a.w *= TO_EXP2;
            b.x *= TO_EXP2;
            as_[local] = a;
//#if PACKED
//#if DEPTH
            ds[local] = b.w;
//#endif
            b.w = unpack2x16float(bitcast<u32>(b.y)).y;
            b.y = opacity_of(b);
            bs[local] = vec4<f32>(b.x, b.y, b.z, b.w);
//#else
            bs[local] = b;
            cs[local] = shades[record];
//#endif
//#if SUBGROUPS
            blocks = touched_blocks(a, b.x, b.y, corner);
//#endif
//#if PLANE
            ps[local] = planes[record];
//#endif
        }
//#if SUBGROUPS
        for (var block = 0u; block < SUBGROUP_COUNT; block++) {
            let votes = subgroupBallot(((blocks >> block) & 1u) == 1u).x;
            if lane == 0u {
                touching[block * SUBGROUP_COUNT + subgroup] = votes;
            }
        }
//#endif
        workgroupBarrier();
        let held = min(range.y - start, 256u);
//#if SUBGROUPS
        for (var base = 0u; base < held; base += SUBGROUP_SIZE) {
            if subgroupAll(least > 1.0) {
                break;
            }
            var votes = touching[own_block * SUBGROUP_COUNT + base / SUBGROUP_SIZE];
            while votes != 0u {
                let k = base + firstTrailingBit(votes);
                votes &= votes - 1u;
//#else
        {
            for (var k = 0u; k < held; k++) {
                if least > 1.0 {
                    break;
                }
//#endif
                let a = as_[k];
                let b = bs[k];
                let d = at - a.xy;
                let along = a.z * d.x + a.w * d.y;
                let over = b.x * d.y;
                let alpha = min(b.y * exp2(-(along * along + over * over)), MAX_ALPHA);
                if alpha >= least {
                    let after = left * (1.0 - alpha);
                    if after <= MIN_TRANSMITTANCE {
                        least = CLOSED;
                    } else {
                        let weight = alpha * left;
                        left = after;
//#if PACKED
                        colour += weight * vec3<f32>(unpack2x16float(bitcast<u32>(b.z)), b.w);
//#if DEPTH
                        depth += weight * ds[k];
//#endif
//#else
                        colour += weight * cs[k].xyz;
//#if DEPTH
                        depth += weight * cs[k].w;
//#endif
//#endif
//#if PLANE
                        plane += weight * ps[k];
//#endif
//#if FEATURES
                        let feature = bitcast<u32>(b.w) * FEATURE_COUNT;
//#repeat FEATURES
                        sums[$K] += weight * features[feature + $Ku];
//#end
//#endif
//#if KEEP
                        last = start + k + 1u;
//#endif
                    }
                }
            }
        }
        if least > 1.0 && !counted {
            counted = true;
            atomicAdd(&closed, 1u);
        }
        workgroupBarrier();
        if local == 0u {
            all_closed = atomicLoad(&closed);
        }
        if workgroupUniformLoad(&all_closed) == 256u {
            break;
        }
    }
    if !inside {
        return;
    }
    let pixel = lenses[view].first_pixel + y * size.x + x;
    colour += left * look.background.xyz;
//#if BYTES
    colours[pixel] = pack4x8unorm(vec4<f32>(colour, 1.0 - left));
//#else
    colours[pixel] = vec4<f32>(colour, 1.0 - left);
//#endif
//#if DEPTH
    depths[pixel] = select(0.0, depth / (1.0 - left), left < 1.0);
//#endif
//#if PLANE
    let ray = vec3<f32>((at - lenses[view].centre) / lenses[view].focal, 1.0);
    let facing = -dot(plane.xyz, ray);
    plane_image[pixel] = vec4<f32>(plane.xyz, select(0.0, plane.w / facing, facing > MIN_FACING));
//#endif
//#if FEATURES
//#repeat FEATURES
    feature_image[pixel * FEATURE_COUNT + $Ku] = sums[$K];
//#end
//#endif
//#if KEEP
    left_image[pixel] = vec2<u32>(bitcast<u32>(left), last);
//#endif
}
