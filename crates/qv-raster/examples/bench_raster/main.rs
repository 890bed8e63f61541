//! Measures the rasteriser on the yard of `qv_raster::workload`:
//!
//! `cargo run --release -p quadverse-raster --features gpu --example bench_raster -- 300000 0 128 [--depth] [--all] [--bytes] [--keep]
//! [--width 640] [--height 480] [--frames 20] [--cpu] [--without-subgroups]
//! [--check] [--backward] [--atomic] [--moving N] [--json] [--adapter] [--save FILE]`
//!
//! takes Gaussians, degree of the spherical harmonics, cameras. On the graphics card it warms up for 0.3 s, then prints the medians
//! of time stamps by stage. `--cpu` measures the CPU instead, forward and backward, on four cameras at most. `--check` compares
//! some cameras' images with those of the CPU. `--backward` times forward and backward together, `--atomic` with
//! float atomics. `--moving N` draws the scene once and keeps its images; what is timed is N other Gaussians drawn and put before them (the
//! protocol of GS-Playground: static background prepared, cameras that stay). `--json` adds a last line of JSON, which `cargo xtask bench raster` reads. `--adapter` only shows the graphics adapter, in JSON.
//! `--save` only writes the scene (`scene_file.rs`).

mod scene_file;

use qv_core::GaussianCloud;
use qv_raster::gpu::{Gpu, GpuCloud, GpuOptions, GpuRasteriser, GpuSettings};
use qv_raster::{Frame, Outputs, Scene, Settings, View, workload};
use serde_json::json;
use std::error::Error;
use std::path::PathBuf;
use std::time::{Duration, Instant};

struct Arguments {
    numbers: Vec<usize>,
    flags: Vec<String>,
    named: Vec<(String, usize)>,
    save: Option<PathBuf>,
}

impl Arguments {
    fn read() -> Result<Self, Box<dyn Error>> {
        let mut out = Self { numbers: vec![], flags: vec![], named: vec![], save: None };
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            match word.as_str() {
                "--width" | "--height" | "--frames" | "--moving" => {
                    let value = words.next().ok_or_else(|| format!("{word}: expected a number, found nothing"))?;
                    out.named.push((word, value.parse()?));
                }
                "--save" => out.save = Some(words.next().ok_or("--save: expected a file, found nothing")?.into()),
                _ if word.starts_with("--") => out.flags.push(word),
                _ => out.numbers.push(word.parse().map_err(|error| format!("{word:?}: {error}"))?),
            }
        }
        Ok(out)
    }

    fn has(&self, flag: &str) -> bool {
        self.flags.iter().any(|known| known == flag)
    }

    fn named(&self, name: &str, otherwise: usize) -> usize {
        self.named.iter().find(|(known, _)| known == name).map_or(otherwise, |(_, value)| *value)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::read()?;
    if arguments.has("--adapter") {
        println!("{}", adapter());
        return Ok(());
    }
    let number = |at: usize, otherwise: usize| arguments.numbers.get(at).copied().unwrap_or(otherwise);
    let (count, degree, cameras) = (number(0, 100_000), number(1, 0), number(2, 128));
    let (width, height) = (arguments.named("--width", 640), arguments.named("--height", 480));
    let outputs = match (arguments.has("--all"), arguments.has("--depth")) {
        (true, _) => Outputs { features: false, ..Outputs::ALL },
        (_, depth) => Outputs { depth, ..Default::default() },
    };
    let settings = Settings { outputs, background: [0.0; 3], antialias: false };
    let cloud = workload::cloud(count, degree as u8, 1);
    let cameras = workload::cameras(cameras, 1, width as u32, height as u32);
    if cameras.is_empty() {
        return Err("expected at least one camera, found none".into());
    }
    if let Some(path) = &arguments.save {
        return Ok(scene_file::save(path, &cloud, &cameras)?);
    }
    let views: Vec<View> = cameras.into_iter().map(View::of).collect();
    println!("{count} Gaussians, degree {degree}, {} cameras of {width}x{height}, {settings:?}", views.len());
    let figures = match (arguments.has("--cpu"), arguments.named("--moving", 0)) {
        (true, _) => cpu(&cloud, &views, &settings)?,
        (_, 0) => card(&cloud, &views, &settings, &arguments)?,
        (_, moving) => over_backdrop(&cloud, &workload::cloud(moving, degree as u8, 2), &views, &settings, &arguments)?,
    };
    if arguments.has("--json") {
        println!("{figures}");
    }
    Ok(())
}

/// The adapter that would be measured, or why there is none.
fn adapter() -> serde_json::Value {
    match Gpu::new(&GpuOptions::default()) {
        Ok(gpu) => json!({
            "name": gpu.info.name,
            "driver": gpu.info.driver_info,
            "software": gpu.info.device_type == wgpu::DeviceType::Cpu,
            "atomic": gpu.float_atomics && gpu.subgroup > 0,
        }),
        Err(error) => json!({ "missing": error.to_string() }),
    }
}

/// Seconds per image on the CPU.
fn cpu(cloud: &GaussianCloud, views: &[View], settings: &Settings) -> Result<serde_json::Value, Box<dyn Error>> {
    let scene = Scene::still(cloud);
    let (mut forward, mut backward) = (vec![], vec![]);
    for view in views.iter().take(4).chain(views.iter().take(1)) {
        let start = Instant::now();
        let frame = Frame::new(&scene, &[*view], settings)?;
        let images = frame.images();
        forward.push(start.elapsed().as_secs_f64());
        let mut by_images = frame.blank_images();
        by_images[0].colour.fill(1.0);
        let start = Instant::now();
        let gradients = frame.gradients(&scene, &by_images)?;
        backward.push(start.elapsed().as_secs_f64());
        println!(
            "  {} candidates, {} entries, mean alpha {:.3}, |pose gradient| {:.3e}",
            frame.candidates.len(),
            frame.entries.tiles.len(),
            images[0].alpha.iter().sum::<f32>() / images[0].alpha.len() as f32,
            gradients.poses[0].iter().map(|x| x * x).sum::<f32>().sqrt()
        );
    }
    let (forward, backward) = (median(&mut forward), median(&mut backward));
    println!("CPU, s per image: forward {forward:.4}, backward {backward:.4}");
    let threads = rayon::current_num_threads();
    Ok(json!({ "forward_seconds": forward, "backward_seconds": backward, "threads": threads }))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn card(
    cloud: &GaussianCloud,
    views: &[View],
    settings: &Settings,
    arguments: &Arguments,
) -> Result<serde_json::Value, Box<dyn Error>> {
    let gpu = Gpu::new(&GpuOptions { without_subgroups: arguments.has("--without-subgroups"), adapter: None })?;
    println!("{} ({}), subgroups of {}", gpu.info.name, gpu.info.driver_info, gpu.subgroup);
    let scene = Scene::still(cloud);
    let on_card = GpuCloud::new(&gpu, &scene)?;
    let mut rasteriser = GpuRasteriser::new(gpu);
    let how = GpuSettings {
        bytes: arguments.has("--bytes"),
        keep: arguments.has("--keep") || arguments.has("--backward"),
        atomic: arguments.has("--atomic"),
        timed: true,
    };
    let start = Instant::now();
    let (_, counts) = rasteriser.render(&on_card, &scene, views, settings, &how)?;
    println!(
        "first {:.2} s; {} candidates and {} entries per image; buffers {:.0} MB",
        start.elapsed().as_secs_f64(),
        counts.candidates / views.len(),
        counts.entries / views.len(),
        rasteriser.bytes() as f64 / 1e6
    );
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(300) {
        rasteriser.submit(&on_card, false)?;
        rasteriser.gpu.wait()?;
    }
    let frames = arguments.named("--frames", 20);
    let backward = arguments.has("--backward");
    if backward {
        let mut by_images = Frame::new(&scene, &views[..1], settings)?.blank_images();
        by_images[0].colour.fill(1.0 / 300_000.0);
        rasteriser.write_image_gradients(&vec![by_images[0].clone(); views.len()])?;
    }
    let mut times: Vec<(&'static str, Vec<f64>)> = vec![];
    for _ in 0..frames {
        rasteriser.submit(&on_card, true)?;
        let mut found = rasteriser.times()?;
        if backward {
            rasteriser.submit_backward(&on_card, true)?;
            let both = [found.pop(), rasteriser.times()?.pop()].into_iter().flatten().map(|(_, time)| time).sum();
            found.extend(rasteriser.times()?.into_iter().filter(|(name, _)| *name != "total"));
            found.push(("total", both));
        }
        for (name, time) in found {
            match times.iter_mut().find(|(known, _)| *known == name) {
                Some((_, all)) => all.push(time),
                None => times.push((name, vec![time])),
            }
        }
    }
    let mut total = None;
    for (name, times) in &mut times {
        let ms = median(times);
        total = (*name == "total").then_some(ms).or(total);
        let rate =
            if *name == "total" { format!(", {:.0} images/s", 1e3 * views.len() as f64 / ms) } else { String::new() };
        println!("  {name:16} {ms:9.3} ms{rate}");
    }
    let start = Instant::now();
    for _ in 0..frames {
        rasteriser.submit(&on_card, false)?;
        if backward {
            rasteriser.submit_backward(&on_card, false)?;
        }
    }
    rasteriser.gpu.wait()?;
    let wall = start.elapsed().as_secs_f64() / frames as f64;
    println!("  wall, queued     {:9.3} ms, {:.0} images/s", 1e3 * wall, views.len() as f64 / wall);
    if arguments.has("--check") {
        check(&mut rasteriser, &on_card, &scene, views, settings, &how)?;
    }
    let cloud_buffers = [&on_card.means, &on_card.scales, &on_card.rotations, &on_card.sh, &on_card.features];
    let cloud_bytes: u64 = cloud_buffers.iter().map(|buffer| buffer.size()).sum();
    Ok(json!({
        "images": views.len(),
        "stamps_milliseconds": total,
        "queued_milliseconds": 1e3 * wall,
        "bytes": rasteriser.bytes() + cloud_bytes,
    }))
}

/// A few Gaussians before prepared images of the others.
fn over_backdrop(
    cloud: &GaussianCloud,
    moving: &GaussianCloud,
    views: &[View],
    settings: &Settings,
    arguments: &Arguments,
) -> Result<serde_json::Value, Box<dyn Error>> {
    let mut rasteriser = GpuRasteriser::new(Gpu::new(&GpuOptions::default())?);
    let how = GpuSettings { bytes: arguments.has("--bytes"), ..Default::default() };
    let (scene, objects) = (Scene::still(cloud), Scene::still(moving));
    let backdrop = {
        let on_card = GpuCloud::new(&rasteriser.gpu, &scene)?;
        rasteriser.render(&on_card, &scene, views, settings, &how)?;
        rasteriser.backdrop()?
    };
    let mut rasteriser = GpuRasteriser::new(rasteriser.gpu);
    let on_card = GpuCloud::new(&rasteriser.gpu, &objects)?;
    rasteriser.render(&on_card, &objects, views, settings, &how)?;
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(300) {
        rasteriser.submit(&on_card, false)?;
        rasteriser.compose(&backdrop, false)?;
        rasteriser.gpu.wait()?;
    }
    let frames = arguments.named("--frames", 20);
    let mut stamps = vec![];
    for _ in 0..frames {
        rasteriser.submit(&on_card, true)?;
        let drawn = rasteriser.times()?.pop().map(|(_, ms)| ms);
        let composed = rasteriser.compose(&backdrop, true)?.pop().map(|(_, ms)| ms);
        stamps.extend(drawn.zip(composed).map(|(a, b)| a + b));
    }
    let start = Instant::now();
    for _ in 0..frames {
        rasteriser.submit(&on_card, false)?;
        rasteriser.compose(&backdrop, false)?;
    }
    rasteriser.gpu.wait()?;
    let wall = start.elapsed().as_secs_f64() / frames as f64;
    let rate = views.len() as f64 / wall;
    println!("  {} moving before a backdrop: queued {:.3} ms, {rate:.0} images/s", moving.len(), 1e3 * wall);
    let total = (!stamps.is_empty()).then(|| median(&mut stamps));
    let bytes = rasteriser.bytes() + backdrop.bytes();
    Ok(
        json!({ "images": views.len(), "stamps_milliseconds": total, "queued_milliseconds": 1e3 * wall, "bytes": bytes }),
    )
}

/// Compares with the CPU.
fn check(
    rasteriser: &mut GpuRasteriser,
    on_card: &GpuCloud,
    scene: &Scene,
    views: &[View],
    settings: &Settings,
    how: &GpuSettings,
) -> Result<(), Box<dyn Error>> {
    let (images, _) = rasteriser.render(on_card, scene, views, settings, how)?;
    let found = images.read()?;
    let picked = [0, views.len() / 2, views.len() - 1];
    for view in picked {
        let expected = &Frame::new(scene, &[views[view]], settings)?.images()[0];
        let errors = expected.colour.iter().zip(&found[view].colour).map(|(a, b)| (a - b).abs());
        let (mut most, mut sum, mut off) = (0.0f32, 0.0f64, 0);
        for error in errors {
            most = most.max(error);
            sum += error as f64;
            off += (error > 1e-3) as usize;
        }
        let n = expected.colour.len();
        println!(
            "  view {view}: colour off by {most:.1e} at most, {:.1e} on average; {off} of {n} by more than 1e-3",
            sum / n as f64
        );
    }
    Ok(())
}
