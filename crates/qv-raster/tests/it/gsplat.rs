//! Images and derivatives against gsplat 1.5.3: its PyTorch projection, covariance and spherical harmonics, blended densely in
//! double precision and differentiated by PyTorch (`fixtures/gsplat`).

use qv_core::{Camera, GaussianCloud, Pose};
use qv_raster::{Frame, Outputs, Scene, Settings, View};
use serde_json::Value;

fn golden(name: &str) -> Value {
    let path = format!("{}/../../fixtures/gsplat/golden/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        _ => vec![value.as_f64().unwrap()],
    }
}

fn rows<const N: usize>(value: &Value) -> Vec<[f32; N]> {
    let all = numbers(value);
    all.chunks_exact(N).map(|row| std::array::from_fn(|k| row[k] as f32)).collect()
}

fn cloud(golden: &Value) -> GaussianCloud {
    let cloud = &golden["cloud"];
    GaussianCloud {
        means: rows(&cloud["means"]),
        log_scales: rows(&cloud["log_scales"]),
        rotations: rows(&cloud["rotations"]),
        opacity_logits: numbers(&cloud["opacity_logits"]).iter().map(|&x| x as f32).collect(),
        sh_degree: golden["options"]["sh_degree"].as_u64().unwrap() as u8,
        sh: rows(&cloud["sh"]),
        ..Default::default()
    }
}

fn view(value: &Value) -> View {
    let number = |key: &str| value[key].as_f64().unwrap();
    let list = |key: &str| numbers(&value[key]);
    let (p, q) = (list("position"), list("wxyz"));
    let pose = Pose::from_position_wxyz([p[0], p[1], p[2]], [q[0], q[1], q[2], q[3]]).unwrap();
    View::of(Camera {
        fx: number("fx"),
        fy: number("fy"),
        cx: number("cx"),
        cy: number("cy"),
        width: number("width") as u32,
        height: number("height") as u32,
        camera_from_world: pose,
    })
}

fn cosine(a: &[f64], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, &b) in a.iter().zip(b) {
        (ab, aa, bb) = (ab + a * b as f64, aa + a * a, bb + (b as f64).powi(2));
    }
    assert!((aa / bb).sqrt() > 0.99 && (aa / bb).sqrt() < 1.01, "lengths {} {}", aa.sqrt(), bb.sqrt());
    ab / (aa * bb).sqrt()
}

fn compare(name: &str) {
    let golden = golden(name);
    let (cloud, views) = (cloud(&golden), golden["views"].as_array().unwrap().iter().map(view).collect::<Vec<_>>());
    let scene = Scene::still(&cloud);
    let outputs = Outputs { depth: true, ..Default::default() };
    let frame = Frame::new(&scene, &views, &Settings { outputs, ..Default::default() }).unwrap();
    let mut by_images = frame.blank_images();
    let (tolerance, mut worst) = (golden["tolerance"]["pixel"].as_f64().unwrap(), 0.0f64);
    for ((image, by_image), expected) in
        frame.images().iter().zip(&mut by_images).zip(golden["images"].as_array().unwrap())
    {
        let close: Vec<usize> = numbers(&expected["close"]).iter().map(|&x| x as usize).collect();
        let pixels = numbers(&expected["pixels"]);
        assert!(close.len() <= image.alpha.len() / 50, "{name}: {} close pixels", close.len());
        for pixel in (0..image.alpha.len()).filter(|pixel| !close.contains(pixel)) {
            let mut found = image.colour[3 * pixel..3 * pixel + 3].to_vec();
            found.extend([image.alpha[pixel], image.depth[pixel]]);
            for (k, found) in found.iter().enumerate() {
                let expected = pixels[5 * pixel + k];
                worst = worst.max((*found as f64 - expected).abs() / expected.abs().max(1.0));
            }
            let weight = |k: usize| (0.7 * (5 * pixel + k) as f64).sin() as f32;
            (0..3).for_each(|k| by_image.colour[3 * pixel + k] = weight(k));
            by_image.alpha[pixel] = weight(3);
            by_image.depth[pixel] = weight(4);
        }
    }
    println!("{name}: off by {worst:.1e}");
    assert!(worst < tolerance, "{name}: {worst}");
    let found = frame.gradients(&scene, &by_images).unwrap();
    let least = golden["tolerance"]["cosine"].as_f64().unwrap();
    for (key, found) in [
        ("means", found.means.as_flattened()),
        ("log_scales", found.log_scales.as_flattened()),
        ("rotations", found.rotations.as_flattened()),
        ("opacity_logits", &found.opacity_logits[..]),
        ("sh", found.sh.as_flattened()),
        ("poses", found.poses.as_flattened()),
    ] {
        let cosine = cosine(&numbers(&golden["gradients"][key]), found);
        println!("{name}: {key}: 1 - cosine {:.1e}", 1.0 - cosine);
        assert!(cosine > least, "{name}: {key}: {cosine}");
    }
}

#[test]
fn images_and_gradients_are_those_of_gsplat() {
    compare("splats_degree_0");
    compare("splats_degree_3");
}
