//! `cargo xtask pictures`: the pictures of README and guides, from what `cargo xtask pipeline` left: a moving one of the place with robot, slips and
//! paths, and the first screen of a report with numbers at its parts.

use crate::pipeline::look;
use crate::{process, workspace::Workspace};
use anyhow::{Context, Result, bail};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use clap::Args;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Frames of the moving picture, and how long each is shown \[ms\].
const FRAMES: usize = 36;
const EACH: u16 = 120;
/// Its size \[px\].
const SIZE: [u32; 2] = [640, 480];
/// A page of GitHub loads larger ones late \[bytes\].
const LARGEST: usize = 4_000_000;
/// Channels that differ by less are the same: the renderer's own noise.
const SAME: u8 = 6;
/// Size of the annotated first screen \[px\].
const SCREEN: [u32; 2] = [1180, 900];

/// Where pages are.
#[derive(Args)]
pub struct Pictures {
    /// Folder of the pipeline; default target/pipeline
    #[arg(long, value_name = "DIR")]
    pipeline: Option<PathBuf>,
    /// Take this page of `qv view` instead of the pipeline's
    #[arg(long, value_name = "FILE")]
    view: Option<PathBuf>,
    /// Take this report of `qv diagnose` instead of the pipeline's
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Moves the time of the page in steps and leaves the canvas of each as PNG, a line each; the camera stands still, so that little changes.
fn film() -> String {
    format!(
        "addEventListener('load',async()=>{{\
         const wait=ms=>new Promise(go=>setTimeout(go,ms)),time=document.getElementById('time'),out=[];\
         document.getElementById('panel').hidden=true;await wait(600);\
         for(let k=0;k<3;k++){{document.getElementById('scene').dispatchEvent(new WheelEvent('wheel',{{deltaY:-200,bubbles:true,cancelable:true}}));await wait(100)}}\
         const from=Number(time.min),to=Number(time.max);\
         for(let k=0;k<{FRAMES};k++){{time.value=from+(to-from)*k/{FRAMES};time.dispatchEvent(new Event('input'));await wait(160);\
         out.push(document.getElementById('scene').toDataURL('image/png').split(',')[1])}}\
         const pre=document.createElement('pre');pre.id='measured';pre.textContent=out.join('\\n');document.body.append(pre)}})"
    )
}

/// Puts numbers at the parts of a report's first screen.
const NUMBERS: &str = "addEventListener('load',()=>{\
const first=q=>document.querySelector(q),parts=[first('.verdict .badge'),...document.querySelectorAll('.answers>div'),\
...document.querySelectorAll('h2+.grid>.card')];\
parts.filter(Boolean).forEach((part,k)=>{const at=part.getBoundingClientRect(),mark=document.createElement('b'),[left,top]=part.matches('.card')?[-11,-11]:[-26,0];\
mark.textContent=k+1;mark.style.cssText='position:absolute;width:22px;height:22px;border-radius:11px;background:#c0263c;color:#fff;\
font:600 13px/22px sans-serif;text-align:center;left:'+(at.left+left)+'px;top:'+(at.top+top+scrollY)+'px';document.body.append(mark)})})";

/// Writes both pictures; true when they are small enough.
///
/// # Errors
/// There is no browser or page, or a picture cannot be made.
pub fn run(workspace: &Workspace, pictures: &Pictures) -> Result<bool> {
    let browser = look::browser().context("cannot make pictures: no Chromium on PATH")?;
    let pipeline = pictures.pipeline.clone().unwrap_or_else(|| workspace.target_directory.join("pipeline"));
    let folder = workspace.workspace_root.join("docs/pictures");
    let view = pictures.view.clone().unwrap_or_else(|| pipeline.join("view/view.html"));
    let moving = folder.join("view.png");
    let bytes = animated(&frames(&browser, &view)?)?;
    println!("{}: {} frames, {:.1} MB", moving.display(), FRAMES, bytes.len() as f64 / 1e6);
    fs::write(&moving, &bytes).with_context(|| format!("writing {}", moving.display()))?;
    let report = pictures.report.clone().unwrap_or_else(|| pipeline.join("diagnose/report.html"));
    let annotated = folder.join("diagnosis.png");
    annotate(&browser, &report, &annotated)?;
    println!("{}", annotated.display());
    if bytes.len() > LARGEST {
        println!("expected at most {LARGEST} bytes, found {}", bytes.len());
    }
    Ok(bytes.len() <= LARGEST)
}

fn headless(browser: &Path, [width, height]: [u32; 2], seconds: u32) -> Command {
    let mut command = Command::new(browser);
    // No sandbox: continuous integration runs as root, and pages are our own. WebGL is drawn by software.
    command.args(["--headless", "--no-sandbox", "--hide-scrollbars", "--use-gl=angle", "--use-angle=swiftshader"]);
    command.args(["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]);
    command.arg(format!("--window-size={width},{height}")).arg(format!("--virtual-time-budget={}", 1000 * seconds));
    command
}

/// An image, red, green, blue and opacity of each pixel.
struct Frame {
    size: [u32; 2],
    rgba: Vec<u8>,
}

fn frames(browser: &Path, page: &Path) -> Result<Vec<Frame>> {
    let text = look::evaluate(page, &film(), &mut headless(browser, SIZE, 60))?;
    let all: Vec<Frame> = text.lines().map(|line| decode(&STANDARD.decode(line)?)).collect::<Result<_>>()?;
    if all.len() != FRAMES {
        bail!("{}: expected {FRAMES} frames, found {}", page.display(), all.len());
    }
    Ok(all)
}

fn decode(bytes: &[u8]) -> Result<Frame> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info()?;
    let mut pixels = vec![0; reader.output_buffer_size().context("a picture that is too large")?];
    let info = reader.next_frame(&mut pixels)?;
    pixels.truncate(info.buffer_size());
    let rgba = match info.color_type {
        png::ColorType::Rgba => pixels,
        png::ColorType::Rgb => pixels.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect(),
        other => bail!("expected a colour picture, found {other:?}"),
    };
    Ok(Frame { size: [info.width, info.height], rgba })
}

/// Frames as an APNG; of each but the first only pixels that changed are kept.
fn animated(frames: &[Frame]) -> Result<Vec<u8>> {
    let first = frames.first().context("expected frames, found none")?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, first.size[0], first.size[1]);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_compression(png::Compression::High);
    encoder.set_animated(u32::try_from(frames.len())?, 0)?;
    encoder.set_frame_delay(EACH, 1000)?;
    encoder.set_dispose_op(png::DisposeOp::None)?;
    let mut writer = encoder.write_header()?;
    let mut shown = vec![0; first.rgba.len()];
    for (k, frame) in frames.iter().enumerate() {
        if frame.size != first.size {
            bail!("expected frames of one size, found {:?} and {:?}", first.size, frame.size);
        }
        if k == 1 {
            writer.set_blend_op(png::BlendOp::Over)?;
        }
        writer.write_image_data(&changes(&mut shown, &frame.rgba))?;
    }
    writer.finish()?;
    Ok(bytes)
}

/// What of a frame differs from what is shown, the rest clear; `shown` becomes what is shown then.
fn changes(shown: &mut [u8], frame: &[u8]) -> Vec<u8> {
    let mut out = vec![0; frame.len()];
    for ((was, is), out) in shown.chunks_exact_mut(4).zip(frame.chunks_exact(4)).zip(out.chunks_exact_mut(4)) {
        if was.iter().zip(is).any(|(a, b)| a.abs_diff(*b) >= SAME) {
            let opaque = [is[0], is[1], is[2], 255];
            was.copy_from_slice(&opaque);
            out.copy_from_slice(&opaque);
        }
    }
    out
}

fn annotate(browser: &Path, report: &Path, picture: &Path) -> Result<()> {
    let copy = look::copy_with(report, NUMBERS)?;
    let mut take = headless(browser, SCREEN, 5);
    take.arg(format!("--screenshot={}", picture.display())).arg(look::address(&copy)?);
    let taken = process::run(take.stdout(Stdio::null()).stderr(Stdio::null()));
    fs::remove_file(&copy).with_context(|| format!("removing {}", copy.display()))?;
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_picture_keeps_what_changed() {
        let frame = |at: usize| {
            let mut rgba = [10, 20, 30, 255].repeat(64);
            rgba[4 * at..4 * at + 4].copy_from_slice(&[200, 0, 0, 255]);
            Frame { size: [8, 8], rgba }
        };
        let bytes = animated(&[frame(3), frame(9)]).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 2);
        let mut pixels = vec![0; 256];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, frame(3).rgba);
        reader.next_frame(&mut pixels).unwrap();
        let drawn: Vec<usize> = (0..64).filter(|k| pixels[4 * k + 3] > 0).collect();
        assert_eq!(drawn, [3, 9], "where it was, and where it is");
    }
}
