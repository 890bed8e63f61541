// Twin of cameras.rs. `turn`, one workgroup, moves the pose of the photograph, and the motion of its camera.

@group(0) @binding(0) var<storage, read> step: Step;
@group(0) @binding(4) var<storage, read> by_pose: array<f32>;
// Rows of camera_from_world of all photographs.
@group(0) @binding(6) var<storage, read_write> motions: array<vec4<f32>>;
// Running means of derivatives by poses and of their squares, 12 for each photograph.
@group(0) @binding(7) var<storage, read_write> pose_moments: array<f32>;
// Of each camera, 32: running means (6 and 6), four that are free, rows of its motion, four that are free.
@group(0) @binding(8) var<storage, read_write> cameras: array<f32>;
// Camera of each photograph.
@group(0) @binding(9) var<storage, read> groups: array<u32>;

// Twists of the camera and of the photograph, the world's share of the latter.
var<workgroup> both: array<f32, 6>;
var<workgroup> own: array<f32, 6>;
var<workgroup> back: array<f32, 6>;

// Adam's running means after a derivative, and the shift that they make in units of the rate.
struct Moved {
    first: f32,
    second: f32,
    shift: f32,
}

fn moved(first: f32, second: f32, by: f32, bias1: f32, bias2: f32) -> Moved {
    let m = BETA1 * first + (1.0 - BETA1) * by;
    let v = BETA2 * second + (1.0 - BETA2) * by * by;
    return Moved(m, v, -(m / bias1) / (sqrt(v / bias2) + EPSILON));
}

// The shift of a number of the camera.
fn shared_shift(at: u32, by: f32) -> f32 {
    let now = moved(cameras[at], cameras[at + 6u], by, step.camera_bias1, step.camera_bias2);
    cameras[at] = now.first;
    cameras[at + 6u] = now.second;
    return now.shift;
}

// The shift of a number of the photograph's pose.
fn own_shift(at: u32, by: f32) -> f32 {
    let now = moved(pose_moments[at], pose_moments[at + 6u], by, step.seen_bias1, step.seen_bias2);
    pose_moments[at] = now.first;
    pose_moments[at + 6u] = now.second;
    return now.shift;
}

// Steps of Adam; by one invocation.
fn decide() {
    let camera = 32u * step.camera;
    for (var k = 0u; k < 6u; k++) {
        let unit = select(1.0, step.extent, k < 3u);
        let by = by_pose[k] * unit;
        both[k] = unit * step.pose_rate * shared_shift(camera + k, by);
        own[k] = unit * step.pose_rate * own_shift(12u * step.photograph + k, by);
    }
    // What the photograph's own motion is in the world; all step back by its mean.
    let m = 3u * step.photograph;
    let w = vec3<f32>(own[3], own[4], own[5]);
    let v = vec3<f32>(own[0], own[1], own[2]) + cross(w, vec3<f32>(motions[m].w, motions[m + 1u].w, motions[m + 2u].w));
    for (var k = 0u; k < 3u; k++) {
        let axis = vec3<f32>(motions[m][k], motions[m + 1u][k], motions[m + 2u][k]);
        back[k] = -dot(axis, v) / f32(step.photographs);
        back[k + 3u] = -dot(axis, w) / f32(step.photographs);
    }
}

struct Rigid {
    x: vec3<f32>,
    y: vec3<f32>,
    z: vec3<f32>,
    t: vec3<f32>,
}

fn rotated(c: vec3<f32>, w: vec3<f32>) -> vec3<f32> {
    let once = cross(w, c);
    return c + once + 0.5 * cross(w, once);
}

// A rigid motion, given by its columns, and then a small twist.
fn turned(before: Rigid, v: vec3<f32>, w: vec3<f32>) -> Rigid {
    let x = normalize(rotated(before.x, w));
    let y = rotated(before.y, w);
    let y_unit = normalize(y - x * dot(x, y));
    return Rigid(x, y_unit, cross(x, y_unit), rotated(before.t, w) + v);
}

@compute @workgroup_size(256)
fn turn(@builtin(local_invocation_index) local: u32) {
    if local == 0u {
        decide();
        let m = 32u * step.camera + 16u;
        let before = Rigid(
            vec3<f32>(cameras[m], cameras[m + 4u], cameras[m + 8u]),
            vec3<f32>(cameras[m + 1u], cameras[m + 5u], cameras[m + 9u]),
            vec3<f32>(cameras[m + 2u], cameras[m + 6u], cameras[m + 10u]),
            vec3<f32>(cameras[m + 3u], cameras[m + 7u], cameras[m + 11u]),
        );
        let after = turned(before, vec3<f32>(both[0], both[1], both[2]), vec3<f32>(both[3], both[4], both[5]));
        for (var k = 0u; k < 3u; k++) {
            cameras[m + 4u * k] = after.x[k];
            cameras[m + 4u * k + 1u] = after.y[k];
            cameras[m + 4u * k + 2u] = after.z[k];
            cameras[m + 4u * k + 3u] = after.t[k];
        }
    }
    storageBarrier();
    workgroupBarrier();
    for (var k = local; k < step.photographs; k += 256u) {
        move_photograph(k, groups[k] == step.camera);
    }
}

fn move_photograph(photograph: u32, same: bool) {
    let m = 3u * photograph;
    let a = motions[m];
    let b = motions[m + 1u];
    let c = motions[m + 2u];
    var pose = Rigid(
        vec3<f32>(a.x, b.x, c.x),
        vec3<f32>(a.y, b.y, c.y),
        vec3<f32>(a.z, b.z, c.z),
        vec3<f32>(a.w, b.w, c.w),
    );
    if photograph == step.photograph {
        pose = turned(pose, vec3<f32>(own[0], own[1], own[2]), vec3<f32>(own[3], own[4], own[5]));
    }
    if same {
        pose = turned(pose, vec3<f32>(both[0], both[1], both[2]), vec3<f32>(both[3], both[4], both[5]));
    }
    // A small motion of the world before the pose is one of the camera after it.
    let w = pose.x * back[3] + pose.y * back[4] + pose.z * back[5];
    let v = pose.x * back[0] + pose.y * back[1] + pose.z * back[2];
    let t = pose.t;
    pose = turned(pose, vec3<f32>(0.0), w);
    pose.t = t + v;
    motions[m] = vec4<f32>(pose.x.x, pose.y.x, pose.z.x, pose.t.x);
    motions[m + 1u] = vec4<f32>(pose.x.y, pose.y.y, pose.z.y, pose.t.y);
    motions[m + 2u] = vec4<f32>(pose.x.z, pose.y.z, pose.z.z, pose.t.z);
}
