// Twin of blend_backward.rs and of resolve_backward: a workgroup for each tile walks its entries from far to near, a batch at a time. What
// comes to an entry is summed over the tile in a fixed order and written where the entry was made. With ATOMIC a workgroup is one
// subgroup, waits for no other, and adds what comes to a record at once, in whatever order.

@group(0) @binding(0) var<storage, read> lenses: array<Lens>;
@group(0) @binding(1) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> sorted: array<u32>;
@group(0) @binding(4) var<storage, read> look: Look;
@group(0) @binding(5) var<storage, read> owners: array<u32>;
@group(0) @binding(6) var<storage, read> left_image: array<vec2<u32>>;
//#if ATOMIC
@group(0) @binding(7) var<storage, read_write> record_gradients: array<atomic<f32>>;
//#else
@group(0) @binding(7) var<storage, read_write> entry_gradients: array<f32>;
//#endif
@group(0) @binding(8) var<storage, read> by_colours: array<vec4<f32>>;
//#if DEPTH
@group(0) @binding(9) var<storage, read> depths: array<f32>;
@group(0) @binding(10) var<storage, read> by_depths: array<f32>;
//#endif
//#if PLANE
@group(0) @binding(11) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> plane_image: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> by_planes: array<vec4<f32>>;
//#endif
//#if FEATURES
@group(0) @binding(14) var<storage, read> features: array<f32>;
@group(0) @binding(15) var<storage, read> by_features: array<f32>;
//#endif

@group(0) @binding(16) var<storage, read> shades: array<vec4<f32>>;

struct Look {
    background: vec4<f32>,
}

// As in blend.wgsl, of a batch of entries.
var<workgroup> as_: array<vec4<f32>, BATCH>;
var<workgroup> bs: array<vec4<f32>, BATCH>;
var<workgroup> cs: array<vec4<f32>, BATCH>;
//#if PLANE
var<workgroup> ps: array<vec4<f32>, BATCH>;
//#endif
//#if SUBGROUPS
// Blocks of pixels that each touches.
var<workgroup> blocks_of: array<u32, BATCH>;
//#endif
//#if ATOMIC
var<workgroup> record_of: array<u32, BATCH>;
//#else
var<workgroup> furthest: atomic<u32>;
var<workgroup> end: u32;
//#if SUBGROUPS
// Sums of each subgroup for each entry of a batch, and which entries it has.
var<workgroup> sums: array<f32, SUM_WORDS>;
var<workgroup> walked: array<u32, SUBGROUP_COUNT>;
//#else
// Eight numbers of all invocations, then sums of sixteen.
var<workgroup> sums: array<f32, 2048>;
var<workgroup> sixteenths: array<f32, 128>;
//#endif
//#endif

//#if SUBGROUPS
// Sum over the subgroup of eight numbers at once, of which lane k holds the sum of number k % 8: at each step a lane gives away
// the half that it will not hold.
fn sum_of_eight(
    v0: f32, v1: f32, v2: f32, v3: f32, v4: f32, v5: f32, v6: f32, v7: f32, lane: u32,
) -> f32 {
    let upper4 = (lane & 4u) != 0u;
    let a0 = select(v0, v4, upper4) + subgroupShuffleXor(select(v4, v0, upper4), 4u);
    let a1 = select(v1, v5, upper4) + subgroupShuffleXor(select(v5, v1, upper4), 4u);
    let a2 = select(v2, v6, upper4) + subgroupShuffleXor(select(v6, v2, upper4), 4u);
    let a3 = select(v3, v7, upper4) + subgroupShuffleXor(select(v7, v3, upper4), 4u);
    let upper2 = (lane & 2u) != 0u;
    let b0 = select(a0, a2, upper2) + subgroupShuffleXor(select(a2, a0, upper2), 2u);
    let b1 = select(a1, a3, upper2) + subgroupShuffleXor(select(a3, a1, upper2), 2u);
    let upper1 = (lane & 1u) != 0u;
    var sum = select(b0, b1, upper1) + subgroupShuffleXor(select(b1, b0, upper1), 1u);
    if SUBGROUP_SIZE > 8u {
        sum += subgroupShuffleXor(sum, 8u);
    }
    if SUBGROUP_SIZE > 16u {
        sum += subgroupShuffleXor(sum, 16u);
    }
    return sum;
}
//#endif

@compute @workgroup_size(GROUP_SIZE)
fn blend_backward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) invocation: u32,
//#if SUBGROUPS
    @builtin(subgroup_invocation_id) lane: u32,
    @builtin(subgroup_id) subgroup: u32,
//#endif
) {
    let view = group.y / GROUPS_PER_TILE;
    let local = group.y % GROUPS_PER_TILE * GROUP_SIZE + invocation;
    let size = lenses[view].size;
    let across = lenses[view].tiles;
    if group.x >= across.x * across.y {
        return;
    }
    let tile = lenses[view].first_tile + group.x;
    let x = group.x % across.x * TILE + squeeze(local);
    let y = group.x / across.x * TILE + squeeze(local >> 1u);
    let at = vec2<f32>(f32(x), f32(y)) + 0.5;
    var left = 1.0;
    var last = 0u;
    // Derivatives by the sums of the pixel, and by what is left times that.
    var by: array<f32, CHANNELS>;
    var behind = 0.0;
    if x < size.x && y < size.y {
        let pixel = lenses[view].first_pixel + y * size.x + x;
        left = bitcast<f32>(left_image[pixel].x);
        last = left_image[pixel].y;
        let by_colour = by_colours[pixel];
        by[0] = by_colour.x;
        by[1] = by_colour.y;
        by[2] = by_colour.z;
        var by_left = dot(by_colour.xyz, look.background.xyz) - by_colour.w;
//#if DEPTH
        if left < 1.0 {
            by[DEPTH_AT] = by_depths[pixel] / (1.0 - left);
            by_left += by[DEPTH_AT] * depths[pixel];
        }
//#endif
//#if PLANE
        let ray = vec3<f32>((at - lenses[view].centre) / lenses[view].focal, 1.0);
        let found = plane_image[pixel];
        let by_plane = by_planes[pixel];
        let facing = -dot(found.xyz, ray);
        var by_normal = by_plane.xyz;
        if facing > MIN_FACING {
            by[PLANE_AT + 3u] = by_plane.w / facing;
            by_normal += ray * (by[PLANE_AT + 3u] * found.w);
        }
        by[PLANE_AT] = by_normal.x;
        by[PLANE_AT + 1u] = by_normal.y;
        by[PLANE_AT + 2u] = by_normal.z;
//#endif
//#if FEATURES
//#repeat FEATURES
        by[FEATURES_AT + $Ku] = by_features[pixel * FEATURE_COUNT + $Ku];
//#end
//#endif
        behind = left * by_left;
    }
    let first = ranges[tile].x;
//#if ATOMIC
    var stop = subgroupMax(last);
//#else
    if local == 0u {
        atomicStore(&furthest, 0u);
    }
    workgroupBarrier();
    atomicMax(&furthest, last);
    workgroupBarrier();
    if local == 0u {
        end = atomicLoad(&furthest);
    }
    var stop = workgroupUniformLoad(&end);
//#endif
//#if SUBGROUPS
    let furthest_here = subgroupMax(last);
    let own_block = block_of(x % TILE, y % TILE);
    let corner = vec2<f32>(f32(group.x % across.x * TILE), f32(group.x / across.x * TILE)) + 0.5;
//#endif
    // Entries beyond are zeros already.
    while stop > first {
        let start = max(i32(first), i32(stop) - i32(BATCH));
        let held = stop - u32(start);
        if invocation < held {
            let record = owners[sorted[u32(start) + invocation]];
            var a = records[2u * record];
            var b = records[2u * record + 1u];
            a.z *= TO_EXP2;
            a.w *= TO_EXP2;
            b.x *= TO_EXP2;
            as_[invocation] = a;
            bs[invocation] = b;
            cs[invocation] = shades[record];
//#if ATOMIC
            record_of[invocation] = record;
//#endif
//#if SUBGROUPS
            blocks_of[invocation] = touched_blocks(a, b.x, b.y, corner);
//#endif
//#if PLANE
            ps[invocation] = planes[record];
//#endif
        }
//#if SUBGROUPS
//#if ATOMIC
//#else
        if lane == 0u {
            walked[subgroup] = 0u;
        }
//#endif
//#endif
        workgroupBarrier();
//#if SUBGROUPS
        for (var chunk = (held + SUBGROUP_SIZE - 1u) / SUBGROUP_SIZE; chunk > 0u; chunk--) {
            let base = (chunk - 1u) * SUBGROUP_SIZE;
            var touched = base + lane < held && u32(start) + base + lane < furthest_here;
            if touched {
                touched = ((blocks_of[base + lane] >> own_block) & 1u) == 1u;
            }
            var votes = subgroupBallot(touched).x;
            while votes != 0u {
                let k = base + firstLeadingBit(votes);
                votes ^= 1u << (k - base);
//#else
        {
            for (var k = held; k > 0u;) {
                k--;
//#endif
                let index = u32(start) + k;
                let a = as_[k];
                let b = bs[k];
                let c = cs[k];
                let d = at - a.xy;
                let along = a.z * d.x + a.w * d.y;
                let over = b.x * d.y;
                let falloff = exp2(-(along * along + over * over));
                let raw = b.y * falloff;
                var alpha = min(raw, MAX_ALPHA);
                let taken = alpha >= MIN_ALPHA && index < last;
//#if SUBGROUPS
                if !subgroupAny(taken) {
                    continue;
                }
//#endif
                var numbers: array<f32, NUMBERS>;
                if taken {
                    var product = by[0] * c.x + by[1] * c.y + by[2] * c.z;
//#if DEPTH
                    product += by[DEPTH_AT] * c.w;
//#endif
//#if PLANE
                    let p = ps[k];
                    product += by[PLANE_AT] * p.x + by[PLANE_AT + 1u] * p.y + by[PLANE_AT + 2u] * p.z + by[PLANE_AT + 3u] * p.w;
//#endif
//#if FEATURES
                    let feature = bitcast<u32>(b.w) * FEATURE_COUNT;
//#repeat FEATURES
                    product += by[FEATURES_AT + $Ku] * features[feature + $Ku];
//#end
//#endif
                    let inverse = 1.0 / (1.0 - alpha);
                    left *= inverse;
                    let by_alpha = left * product - behind * inverse;
                    let weight = alpha * left;
                    behind += weight * product;
                    // Where the opacity is cut off it does not depend on the Gaussian.
                    let by_raw = select(0.0, by_alpha, raw < MAX_ALPHA);
                    // By half of |e|² before it was scaled for exp2: `along` and `over` are those of the scaled one.
                    let by_square = -raw * by_raw * FROM_EXP2;
                    numbers[0] = -by_square * (a.z * along);
                    numbers[1] = -by_square * (a.w * along + b.x * over);
                    numbers[2] = by_square * (0.5 * along * along);
                    numbers[3] = by_square * (along * over);
                    numbers[4] = by_square * (0.5 * over * over);
                    numbers[5] = by_raw * falloff;
//#repeat CHANNELS
                    numbers[6u + $Ku] = weight * by[$K];
//#end
                }
//#if SUBGROUPS
//#repeat EIGHTS
                if 8u * $Ku + 1u == WIDTH {
                    let sum = subgroupAdd(numbers[8u * $Ku]);
                    if lane == 0u {
//#if ATOMIC
                        atomicAdd(&record_gradients[record_of[k] * WIDTH + 8u * $Ku], sum);
//#else
                        sums[(subgroup * BATCH + k) * NUMBERS + 8u * $Ku] = sum;
//#endif
                    }
                } else {
                    let sum = sum_of_eight(
                        numbers[8u * $Ku], numbers[8u * $Ku + 1u], numbers[8u * $Ku + 2u], numbers[8u * $Ku + 3u],
                        numbers[8u * $Ku + 4u], numbers[8u * $Ku + 5u], numbers[8u * $Ku + 6u], numbers[8u * $Ku + 7u],
                        lane,
                    );
//#if ATOMIC
                    if lane < 8u && 8u * $Ku + lane < WIDTH {
                        atomicAdd(&record_gradients[record_of[k] * WIDTH + 8u * $Ku + lane], sum);
                    }
//#else
                    if lane < 8u {
                        sums[(subgroup * BATCH + k) * NUMBERS + 8u * $Ku + lane] = sum;
                    }
//#endif
                }
//#end
//#if ATOMIC
//#else
                if lane == 0u {
                    walked[subgroup] |= 1u << k;
                }
//#endif
//#else
                for (var eight = 0u; eight < NUMBERS; eight += 8u) {
                    workgroupBarrier();
                    for (var j = 0u; j < 8u; j++) {
                        sums[j * 256u + local] = numbers[eight + j];
                    }
                    workgroupBarrier();
                    if local < 128u {
                        var sum = 0.0;
                        for (var j = 0u; j < 16u; j++) {
                            sum += sums[local * 16u + j];
                        }
                        sixteenths[local] = sum;
                    }
                    workgroupBarrier();
                    if local < 8u && eight + local < WIDTH {
                        var sum = 0.0;
                        for (var j = 0u; j < 16u; j++) {
                            sum += sixteenths[local * 16u + j];
                        }
                        entry_gradients[sorted[index] * WIDTH + eight + local] = sum;
                    }
                }
//#endif
            }
        }
//#if SUBGROUPS
//#if ATOMIC
//#else
        workgroupBarrier();
        for (var place = local; place < held * WIDTH; place += 256u) {
            let k = place / WIDTH;
            var sum = 0.0;
            for (var s = 0u; s < SUBGROUP_COUNT; s++) {
                if ((walked[s] >> k) & 1u) != 0u {
                    sum += sums[(s * BATCH + k) * NUMBERS + place % WIDTH];
                }
            }
            entry_gradients[sorted[u32(start) + k] * WIDTH + place % WIDTH] = sum;
        }
//#endif
//#endif
        workgroupBarrier();
        stop = u32(start);
    }
}
