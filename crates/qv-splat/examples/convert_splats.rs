//! Converts one format of splats into another: `cargo run --release -p quadverse-splat --example convert_splats -- in.ply out.spz`.
//!
//! The input's format is given by its content, the output's by its name: .ply, .compressed.ply, .spz, .glb. `--spz-version 4`
//! writes that version of SPZ. Without arguments a made-up Gaussian is converted through all of them.
use qv_core::GaussianCloud;
use qv_splat::files::spz::{Version, write_version};
use qv_splat::files::{Format, ply, read_any, write};
use std::error::Error;
use std::fs;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (from, to) = match &arguments[..] {
        [] => return made_up(),
        [from, to, ..] => (from, to),
        [_] => return Err("expected a file to read and a file to write, found one name".into()),
    };
    let file = read_any(&fs::read(from)?)?;
    let format = Format::of_name(to).ok_or("expected a name that ends in .ply, .spz or .glb")?;
    let version = match &arguments[2..] {
        [] => None,
        [flag, number] if flag == "--spz-version" && format == Format::Spz => match number.as_str() {
            "2" => Some(Version::V2),
            "3" => Some(Version::V3),
            "4" => Some(Version::V4),
            other => return Err(format!("--spz-version: expected 2, 3 or 4, found {other}").into()),
        },
        other => return Err(format!("expected --spz-version N for SPZ, found {other:?}").into()),
    };
    let bytes = match version {
        Some(version) => write_version(&file.cloud, version)?,
        None if format == Format::Ply => ply::write_over(&file.cloud, file.background)?,
        None => write(&file.cloud, format)?,
    };
    fs::write(to, &bytes)?;
    let (count, degree) = (file.cloud.len(), file.cloud.sh_degree);
    println!(
        "{count} Gaussians of degree {degree}, {} left out: {} to {}",
        file.left_out,
        file.format.name(),
        format.name()
    );
    file.lost.iter().for_each(|lost| println!("lost: {lost}"));
    Ok(())
}

fn made_up() -> Result<(), Box<dyn Error>> {
    let cloud = GaussianCloud {
        means: vec![[1.0, 2.0, 3.0]],
        log_scales: vec![[-3.0, -2.0, -4.0]],
        rotations: vec![[0.9, 0.1, -0.3, 0.2]],
        opacity_logits: vec![2.0],
        sh: vec![[0.5, 0.0, -0.5]],
        ..Default::default()
    };
    for format in Format::ALL {
        let bytes = write(&cloud, format)?;
        let file = read_any(&bytes)?;
        println!(
            "{}: {} bytes, mean {:?}, rotation {:?}",
            format.name(),
            bytes.len(),
            file.cloud.means[0],
            file.cloud.rotations[0]
        );
    }
    Ok(())
}
