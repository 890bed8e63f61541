//! `cargo xtask bench raster`: images of the rasteriser on the adapter that is there, beside gsplat and on the CPU.
//!
//! Each workload is measured as gsplat, ours, gsplat (A B A), each in a process of its own, on one scene in a file.

use super::contest::{build, folder, last_line, median, write};
use crate::process;
use crate::workspace::Workspace;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::Command;

/// How to measure.
#[derive(clap::Args)]
pub struct Raster {
    /// Cameras of a batch [default: 128; 4 on a software adapter]
    #[arg(long)]
    cameras: Option<usize>,
    /// Python with torch, CUDA and gsplat
    #[arg(long, default_value = "python3")]
    python: PathBuf,
}

/// Most views that the rasteriser takes at once.
const MOST_CAMERAS: usize = 4096;
/// Gaussians of the measurement on the CPU.
const CPU_GAUSSIANS: usize = 100_000;

/// How large the workloads are.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Size {
    gaussians: [usize; 3],
    cameras: usize,
    frames: usize,
}

const FULL: Size = Size { gaussians: [100_000, 300_000, 1_000_000], cameras: 128, frames: 20 };
const REDUCED: Size = Size { gaussians: [10_000, 30_000, 100_000], cameras: 4, frames: 3 };

/// A way of ours to draw a workload: its name and the arguments of `bench_raster`.
type Way = (&'static str, &'static [&'static str]);

const FORWARD: [Way; 2] = [("floats", &[]), ("bytes", &["--bytes"])];
const BACKWARD: [Way; 2] = [("ordered sums", &[]), ("atomics", &["--atomic"])];

/// Images of all Gaussians prepared, a tenth as many drawn before them in each frame: GS-Playground's protocol,
/// which is other work than gsplat's and has no rival here.
const PREPARED: [Way; 2] = [("prepared, floats", &[]), ("prepared, bytes", &["--bytes"])];

/// What all contestants draw. `shared` are arguments that the example and gsplat's script have in common.
struct Workload {
    /// Gaussians drawn before prepared images of the others; 0 to draw all.
    moving: usize,
    gaussians: usize,
    degree: u8,
    cameras: usize,
    shared: &'static [&'static str],
    ways: &'static [Way],
}

fn workloads(size: &Size) -> Vec<Workload> {
    let [small, middle, large] = size.gaussians;
    let of = |gaussians, ways| Workload { moving: 0, gaussians, degree: 0, cameras: size.cameras, shared: &[], ways };
    vec![
        of(small, &FORWARD),
        of(middle, &FORWARD),
        of(large, &FORWARD),
        Workload { degree: 3, ..of(middle, &FORWARD[..1]) },
        Workload { shared: &["--depth"], ..of(middle, &FORWARD[..1]) },
        Workload { cameras: 1, shared: &["--backward"], ..of(middle, &BACKWARD) },
        Workload { moving: middle / 10, ..of(middle, &PREPARED) },
    ]
}

impl Workload {
    fn name(&self) -> String {
        let moving = if self.moving > 0 { format!(" and {}k", self.moving / 1000) } else { String::new() };
        let shared: String = self.shared.iter().map(|flag| format!(", {}", flag.trim_start_matches('-'))).collect();
        format!("{}k{moving}, degree {}, x{}{shared}", self.gaussians / 1000, self.degree, self.cameras)
    }

    /// The example with what the scene is made of.
    fn program(&self, ours: &Path) -> Command {
        let mut program = Command::new(ours);
        program.args([self.gaussians.to_string(), self.degree.to_string(), self.cameras.to_string()]);
        program
    }
}

/// What `bench_raster --adapter` or `bench.py --probe` prints: a card, or what is missing.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
enum AdapterProbe {
    Missing {
        missing: String,
    },
    Card {
        name: String,
        /// Of ours only.
        #[serde(default)]
        driver: String,
        /// Of ours only.
        #[serde(default)]
        software: bool,
        /// Of ours only: floats are added up with atomics when asked.
        #[serde(default)]
        atomic: bool,
    },
}

/// What `bench_raster --json` prints of a card.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Ours {
    images: usize,
    /// `None` when the adapter has no time stamps.
    stamps_milliseconds: Option<f64>,
    queued_milliseconds: f64,
    bytes: u64,
}

/// What `bench_raster --cpu --json` prints.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
struct Cpu {
    forward_seconds: f64,
    backward_seconds: f64,
    threads: usize,
}

/// What `bench.py` prints.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Peer {
    images: usize,
    milliseconds: f64,
    bytes: u64,
}

/// One row of the table.
#[derive(Debug, Clone, Serialize)]
struct Row {
    workload: String,
    way: String,
    images: usize,
    stamps_milliseconds: Option<f64>,
    queued_milliseconds: f64,
    bytes: u64,
    /// One for each run; empty without a peer.
    peer_milliseconds: Vec<f64>,
    peer_bytes: Option<u64>,
    /// Speed as a multiple of the peer's, from the queued frames' time and the median of the peer's.
    times_peer: Option<f64>,
}

/// All results.
#[derive(Debug, Clone, Serialize)]
struct Results {
    adapter: String,
    peer: Option<String>,
    rows: Vec<Row>,
    cpu: Cpu,
}

/// Runs the benchmark, which has no gate.
///
/// # Errors
/// A contestant cannot be built, fails, or prints something unexpected.
pub fn run(workspace: &Workspace, raster: &Raster) -> Result<bool> {
    if raster.cameras.is_some_and(|cameras| !(1..=MOST_CAMERAS).contains(&cameras)) {
        bail!("--cameras: expected 1 to {MOST_CAMERAS}, found {}", raster.cameras.unwrap_or_default());
    }
    let ours = build(workspace, "bench_raster", &["gpu"])?;
    let (mut rows, mut adapter, mut peer) = (Vec::new(), "none".into(), None);
    match last_line(Command::new(&ours).arg("--adapter"))? {
        AdapterProbe::Missing { missing } => println!("no adapter, the CPU only: {missing}"),
        AdapterProbe::Card { name, driver, software, atomic } => {
            println!("{name} ({driver})");
            let contest = Contest::new(workspace, raster, ours.clone(), &name, software)?;
            if !atomic {
                println!("this adapter has no atomics for floats: the rows with atomics are ordered sums");
            }
            rows = contest.rows()?;
            (adapter, peer) = (name, contest.peer);
        }
    }
    let cpu = cpu(&ours)?;
    print_table(&rows);
    print_cpu(&cpu);
    let peer = peer.map(|peer| peer.card);
    write(workspace, "raster.json", &Results { adapter, peer, rows, cpu })?;
    Ok(true)
}

/// gsplat's side.
pub struct Rival {
    python: PathBuf,
    script: PathBuf,
    card: String,
}

/// All that is needed to measure on a card.
struct Contest {
    ours: PathBuf,
    size: Size,
    peer: Option<Rival>,
    scene: PathBuf,
}

impl Contest {
    fn new(workspace: &Workspace, raster: &Raster, ours: PathBuf, card: &str, software: bool) -> Result<Self> {
        let mut size = if software { REDUCED } else { FULL };
        size.cameras = raster.cameras.unwrap_or(size.cameras);
        let peer = if software {
            println!("a software adapter: smaller clouds, {} cameras, {} frames, no gsplat", size.cameras, size.frames);
            None
        } else {
            rival(workspace, &raster.python, Some(card))?
        };
        Ok(Self { ours, size, peer, scene: folder(workspace)?.join("raster.scene") })
    }

    fn rows(&self) -> Result<Vec<Row>> {
        let mut rows = Vec::new();
        for workload in workloads(&self.size) {
            eprintln!("{}", workload.name());
            rows.extend(self.one(&workload)?);
        }
        if self.peer.is_some() {
            std::fs::remove_file(&self.scene)?;
        }
        Ok(rows)
    }

    /// A B A, B being all ways of ours.
    fn one(&self, workload: &Workload) -> Result<Vec<Row>> {
        let mut beside = Vec::new();
        let peer = self.peer.as_ref().filter(|_| workload.moving == 0);
        if let Some(peer) = peer {
            process::run(workload.program(&self.ours).arg("--save").arg(&self.scene))?;
            beside.push(self.measure_peer(peer, workload)?);
        }
        let taken: Vec<Ours> = workload.ways.iter().map(|way| self.measure(workload, way)).collect::<Result<_>>()?;
        if let Some(peer) = peer {
            beside.push(self.measure_peer(peer, workload)?);
        }
        Ok(workload.ways.iter().zip(&taken).map(|((way, _), ours)| row(workload.name(), way, ours, &beside)).collect())
    }

    fn measure(&self, workload: &Workload, (_, arguments): &Way) -> Result<Ours> {
        let mut program = workload.program(&self.ours);
        if workload.moving > 0 {
            program.args(["--moving", &workload.moving.to_string()]);
        }
        program.args(workload.shared).args(*arguments).args(["--json", "--frames", &self.size.frames.to_string()]);
        let ours: Ours = last_line(&mut program)?;
        expect(&program, workload, ours.images, &[Some(ours.queued_milliseconds), ours.stamps_milliseconds])?;
        Ok(ours)
    }

    fn measure_peer(&self, peer: &Rival, workload: &Workload) -> Result<Peer> {
        let mut program = python(&peer.python, &peer.script);
        program.arg("--scene").arg(&self.scene).args(workload.shared);
        program.args(["--frames", &self.size.frames.to_string()]);
        let found: Peer = last_line(&mut program)?;
        expect(&program, workload, found.images, &[Some(found.milliseconds)])?;
        Ok(found)
    }
}

/// Checks that a contestant drew what was asked, in a positive time.
fn expect(program: &Command, workload: &Workload, images: usize, times: &[Option<f64>]) -> Result<()> {
    if images != workload.cameras {
        bail!("{program:?}: expected {} images, found {images}", workload.cameras);
    }
    match times.iter().flatten().find(|time| !(time.is_finite() && **time > 0.0)) {
        Some(time) => bail!("{program:?}: expected a positive time, found {time} ms"),
        None => Ok(()),
    }
}

fn python(python: &Path, script: &Path) -> Command {
    let mut program = Command::new(python);
    program.env("PYTHONDONTWRITEBYTECODE", "1").arg(script);
    program
}

/// gsplat, when this Python has it; else says how to get it. `ours` is the name of the card that ours works on, where it is known.
pub fn rival(workspace: &Workspace, with: &Path, ours: Option<&str>) -> Result<Option<Rival>> {
    let script = workspace.workspace_root.join("fixtures/gsplat/bench.py");
    let missing = if process::works(Command::new(with).arg("--version")) {
        match last_line(python(with, &script).arg("--probe"))? {
            AdapterProbe::Card { name: card, .. } => {
                println!("gsplat beside, on {card}");
                if ours.is_some_and(|ours| card != ours) {
                    println!("the cards' names differ: the ratios may compare cards, too");
                }
                return Ok(Some(Rival { python: with.into(), script, card }));
            }
            AdapterProbe::Missing { missing } => missing,
        }
    } else {
        "a Python that starts".into()
    };
    println!(
        "gsplat is skipped, {} lacks: {missing}. To get it, with CUDA's compiler installed: \
         `PYTHON -m pip install -r fixtures/gsplat/requirements.txt`, then `--python PYTHON`",
        with.display()
    );
    Ok(None)
}

fn row(workload: String, way: &str, ours: &Ours, beside: &[Peer]) -> Row {
    let peer_milliseconds: Vec<f64> = beside.iter().map(|peer| peer.milliseconds).collect();
    let times_peer = (!beside.is_empty()).then(|| median(peer_milliseconds.clone()) / ours.queued_milliseconds);
    Row {
        workload,
        way: way.into(),
        images: ours.images,
        stamps_milliseconds: ours.stamps_milliseconds,
        queued_milliseconds: ours.queued_milliseconds,
        bytes: ours.bytes,
        peer_milliseconds,
        peer_bytes: beside.iter().map(|peer| peer.bytes).max(),
        times_peer,
    }
}

fn cpu(ours: &Path) -> Result<Cpu> {
    let mut program = Command::new(ours);
    last_line(program.args([&CPU_GAUSSIANS.to_string(), "0", "4", "--cpu", "--json"]))
}

fn print_table(rows: &[Row]) {
    if rows.is_empty() {
        return;
    }
    println!("| workload | ours | stamps, ms | queued, ms | images/s | MB | gsplat, ms | MB | x gsplat |");
    println!("|---|---|---:|---:|---:|---:|---:|---:|---:|");
    for row in rows {
        println!("{}", line(row));
    }
    println!("MB: all of our buffers; what PyTorch had allocated at most. Both with the cloud.");
}

/// A row of the table.
fn line(row: &Row) -> String {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".into());
    let times: Vec<String> = row.peer_milliseconds.iter().map(|time| format!("{time:.2}")).collect();
    format!(
        "| {} | {} | {} | {:.2} | {:.0} | {:.0} | {} | {} | {} |",
        row.workload,
        row.way,
        or_dash(row.stamps_milliseconds.map(|time| format!("{time:.2}"))),
        row.queued_milliseconds,
        1e3 * row.images as f64 / row.queued_milliseconds,
        row.bytes as f64 / 1e6,
        or_dash((!times.is_empty()).then(|| times.join(" and "))),
        or_dash(row.peer_bytes.map(|bytes| format!("{:.0}", bytes as f64 / 1e6))),
        or_dash(row.times_peer.map(|ratio| format!("{ratio:.2}"))),
    )
}

fn print_cpu(cpu: &Cpu) {
    println!(
        "CPU, {} threads, {}k, degree 0: {:.3} s per image forward, {:.3} s backward",
        cpu.threads,
        CPU_GAUSSIANS / 1000,
        cpu.forward_seconds,
        cpu.backward_seconds
    );
}

#[cfg(test)]
mod tests {
    use super::super::contest::parse;
    use super::*;

    const PRINTED: &str = "300000 Gaussians, degree 0\n  total 6.373 ms, 20084 images/s\n\
        {\"bytes\":1403000000,\"images\":128,\"queued_milliseconds\":6.461,\"stamps_milliseconds\":6.373}\n";

    #[test]
    fn the_last_line_of_the_example_is_read() {
        let ours: Ours = parse(PRINTED).unwrap();
        let expected =
            Ours { images: 128, stamps_milliseconds: Some(6.373), queued_milliseconds: 6.461, bytes: 1_403_000_000 };
        assert_eq!(ours, expected);
        let without: Ours = parse(&PRINTED.replace("6.373}", "null}")).unwrap();
        assert_eq!(without.stamps_milliseconds, None);
        let cpu: Cpu = parse(r#"{"backward_seconds":0.05,"forward_seconds":0.045,"threads":2}"#).unwrap();
        assert_eq!(cpu, Cpu { forward_seconds: 0.045, backward_seconds: 0.05, threads: 2 });
    }

    #[test]
    fn something_else_is_an_error_that_repeats_it() {
        for text in ["", "total 6.373 ms", r#"{"images":128}"#] {
            let error = format!("{:#}", parse::<Ours>(text).unwrap_err());
            assert!(error.contains("expected a last line of JSON") && error.contains(&format!("{text:?}")), "{error}");
        }
    }

    #[test]
    fn adapters_are_told_apart() {
        let card: AdapterProbe = parse(r#"{"atomic":true,"driver":"Mesa","name":"llvmpipe","software":true}"#).unwrap();
        let expected =
            AdapterProbe::Card { name: "llvmpipe".into(), driver: "Mesa".into(), software: true, atomic: true };
        assert_eq!(card, expected);
        let missing: AdapterProbe = parse("gsplat: no toolkit\n{\"missing\": \"No module named 'torch'\"}").unwrap();
        assert_eq!(missing, AdapterProbe::Missing { missing: "No module named 'torch'".into() });
        let peer: AdapterProbe = parse(r#"{"name": "NVIDIA H200", "version": "1.5.3"}"#).unwrap();
        let expected =
            AdapterProbe::Card { name: "NVIDIA H200".into(), driver: String::new(), software: false, atomic: false };
        assert_eq!(peer, expected);
    }

    #[test]
    fn a_contestant_that_drew_something_else_is_refused() {
        let workload = &workloads(&FULL)[0];
        let program = Command::new("bench_raster");
        assert!(expect(&program, workload, 128, &[Some(1.0), None]).is_ok());
        assert!(expect(&program, workload, 127, &[Some(1.0)]).is_err());
        assert!(expect(&program, workload, 128, &[Some(1.0), Some(f64::NAN)]).is_err());
        assert!(expect(&program, workload, 128, &[Some(0.0)]).is_err());
    }

    #[test]
    fn ratios_are_to_the_middle_of_the_peer_and_memory_is_its_peak() {
        let ours = parse::<Ours>(PRINTED).unwrap();
        let peer: Peer =
            parse(r#"{"engine":"gsplat","version":"1.5.3","images":128,"milliseconds":13.0,"bytes":2000000000}"#)
                .unwrap();
        let beside = [peer.clone(), Peer { milliseconds: 12.844, bytes: 2_056_000_000, ..peer }];
        let with = row("300k".into(), "bytes", &ours, &beside);
        assert_eq!(with.times_peer, Some(2.0));
        assert_eq!(line(&with), "| 300k | bytes | 6.37 | 6.46 | 19811 | 1403 | 13.00 and 12.84 | 2056 | 2.00 |");
        let alone = row("300k".into(), "bytes", &ours, &[]);
        assert_eq!(line(&alone), "| 300k | bytes | 6.37 | 6.46 | 19811 | 1403 | - | - | - |");
    }

    #[test]
    fn workloads_are_those_of_the_page() {
        let names: Vec<String> = workloads(&FULL).iter().map(Workload::name).collect();
        let expected = [
            "100k, degree 0, x128",
            "300k, degree 0, x128",
            "1000k, degree 0, x128",
            "300k, degree 3, x128",
            "300k, degree 0, x128, depth",
            "300k, degree 0, x1, backward",
            "300k and 30k, degree 0, x128",
        ];
        assert_eq!(names, expected);
    }
}
