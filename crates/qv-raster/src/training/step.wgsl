// What all kernels of training read; `StepWords` in kernels.rs has the same layout.

struct Step {
    count: u32,
    sh_count: u32,
    iteration: u32,
    seed: u32,
    // Rates of means, log scales, rotations, opacities.
    rates: vec4<f32>,
    colours: f32,
    harmonics: f32,
    bias1: f32,
    bias2: f32,
    // Weights of the regularisers of each Gaussian.
    opacity: f32,
    scale: f32,
    flat: f32,
    noise: f32,
    width: u32,
    height: u32,
    photograph: u32,
    exposes: u32,
    ssim: f32,
    pixel: f32,
    exposure_rate: f32,
    exposure_weight: f32,
    seen_bias1: f32,
    seen_bias2: f32,
    pose_rate: f32,
    extent: f32,
    depth_prior: f32,
    depth_normal: f32,
    groups: u32,
    // Over the number of pixels that are looked at.
    multi_view: f32,
    partner: u32,
    partner_width: u32,
    partner_height: u32,
    from_x: u32,
    from_y: u32,
    // Over the number of pixels.
    labels: f32,
    feature_count: u32,
    feature_rate: f32,
    photographs: u32,
    camera: u32,
    // 1 when poses are learned.
    refines: u32,
    camera_bias1: f32,
    camera_bias2: f32,
    // Share of the Gaussians that the step leaves out.
    drop: f32,
    free1: f32,
    free2: f32,
}

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
const EPSILON: f32 = 1e-15;

fn logistic(x: f32) -> f32 {
    return 1.0 / (1.0 + exp(-x));
}

// Twins of `words` and `unit` in random.rs.
fn words(a: u32, b: u32, c: u32, d: u32) -> vec4<u32> {
    var v = vec4<u32>(a, b, c, d) * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> vec4<u32>(16u);
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

fn unit(word: u32) -> f32 {
    return f32(word >> 8u) * (1.0 / 16777216.0);
}
