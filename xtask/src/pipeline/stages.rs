//! The stages of the pipeline as data: who runs, with which arguments, on which files.

use clap::ValueEnum;
use std::path::PathBuf;

/// Seed of the recordings.
pub const SEED: u64 = 1;

/// The stages, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Stage {
    /// Photographs a synthetic yard
    Yard,
    /// Makes up recordings of a robot that walks through it, and their truth
    Recording,
    /// Says what is in the recordings
    Inspect,
    /// Learns Gaussians from the photographs
    Reconstruct,
    /// Takes a labelled collision mesh from the Gaussians
    Mesh,
    /// Finds the friction of each label from the recordings
    Contact,
    /// Replays a recording on the calibrated ground
    Replay,
    /// Says what makes robot and simulator differ on it
    Diagnose,
    /// Finds the friction once more, with the cause that was found taken into account
    Again,
    /// Trains a walking policy
    Walk,
    /// A made-up robot with hidden effects walks over the yard under that policy
    Record,
    /// Corrects the simulator by those recordings and trains the policy on
    Tune,
    /// That robot walks after commands under both policies
    Paths,
    /// Optional: a network learns in the reconstructed place to reach cones that it sees
    Navigate,
    /// Makes the page in which one looks around
    View,
    /// Puts all of it on one page
    Report,
}

/// How much the stages compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// What a reader of the guides gets.
    Full,
    /// What continuous integration has time for: fewer steps, shorter recordings.
    Small,
}

/// A program of this workspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Program {
    /// The command line.
    Qv,
    /// The maker of the synthetic yard.
    Yard,
}

/// One call of a program, in the pipeline's folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Call {
    /// Who.
    pub program: Program,
    /// Its arguments, between single spaces.
    pub words: &'static str,
    /// File, relative to the pipeline's folder, for what it writes to standard output.
    pub said: Option<&'static str>,
}

const fn qv(words: &'static str) -> Call {
    Call { program: Program::Qv, words, said: None }
}

const fn remarks(words: &'static str, said: &'static str) -> Call {
    Call { program: Program::Qv, words, said: Some(said) }
}

/// The programs in the order in which they are built and passed on, each with its package and its name.
pub const PROGRAMS: [(Program, &str, &str); 2] = [(Program::Qv, "quadverse", "qv"), (Program::Yard, "yard", "yard")];

impl Stage {
    /// As on the command line, and the folder that it writes into.
    pub fn name(self) -> &'static str {
        match self {
            Self::Yard => "yard",
            Self::Recording => "recording",
            Self::Inspect => "inspect",
            Self::Reconstruct => "reconstruct",
            Self::Mesh => "mesh",
            Self::Contact => "contact",
            Self::Replay => "replay",
            Self::Diagnose => "diagnose",
            Self::Again => "again",
            Self::Walk => "walk",
            Self::Record => "record",
            Self::Tune => "tune",
            Self::Paths => "paths",
            Self::Navigate => "navigate",
            Self::View => "view",
            Self::Report => "report",
        }
    }

    /// Whether it runs only when it is asked for.
    pub fn is_optional(self) -> bool {
        self == Self::Navigate
    }

    /// What is run, one after the other; `navigate` says whether the optional stage of that name is there.
    pub fn calls(self, size: Size, navigate: bool) -> &'static [Call] {
        const YARD: [Call; 1] = [Call { program: Program::Yard, words: "--out yard", said: None }];
        // The first walks from concrete onto tiles that are smoother than tiles are, the second from grass onto gravel.
        const RECORDING: [Call; 2] = [
            qv(
                "fixture --terrain yard/truth.glb --start=-0.4,0.35,-1.5708 --friction tiles=0.18 --friction gravel=0.45 --seed 1 --out recording/tiles",
            ),
            qv(
                "fixture --terrain yard/truth.glb --start=1.7,1.2,-1.5708 --friction tiles=0.18 --friction gravel=0.45 --seed 1 --out recording/gravel",
            ),
        ];
        const INSPECT: [Call; 2] = [
            remarks("inspect recording/tiles/run.mcap --json", "inspect/tiles.json"),
            remarks("inspect recording/gravel/run.mcap --json", "inspect/gravel.json"),
        ];
        const RECONSTRUCT: [Call; 1] = [qv(
            "reconstruct yard --out reconstruct --poses capture --background black --iterations 3000 --coarse-to-fine 0.5 --flattening 100 --depth-normal 0.05 --multi-view 0.15 --labels 0.05 --preview --json",
        )];
        const RECONSTRUCT_SMALL: [Call; 1] = [qv(
            "reconstruct yard --out reconstruct --poses capture --background black --iterations 2000 --coarse-to-fine 0.75 --flattening 100 --depth-normal 0.05 --multi-view 0.15 --labels 0.05 --preview --json",
        )];
        const MESH: [Call; 1] = [remarks(
            "mesh reconstruct/scene.ply --cameras yard/transforms.json --labels yard/labels.toml --triangles 40000 \
             --compare yard/truth.glb --out mesh/terrain.glb --json",
            "mesh/mesh.json",
        )];
        const CONTACT: [Call; 1] = [qv(
            "contact recording/tiles/run.mcap recording/gravel/run.mcap --terrain mesh/terrain.glb --out contact --json",
        )];
        const REPLAY: [Call; 1] =
            [qv("replay recording/tiles/run.mcap --terrain contact/terrain.glb --out replay --json")];
        const DIAGNOSE: [Call; 1] =
            [qv("diagnose recording/tiles/run.mcap --terrain contact/terrain.glb --out diagnose --json")];
        const AGAIN: [Call; 1] = [qv(
            "contact recording/tiles/run.mcap recording/gravel/run.mcap --terrain mesh/terrain.glb --params diagnose/calibrated.toml --out again --json",
        )];
        const WALK: [Call; 1] = [qv("walk train --iterations 900 --out walk")];
        const WALK_SMALL: [Call; 1] = [qv("walk train --iterations 600 --out walk")];
        // Short walks: the yard is 6 m wide, and has a wall.
        const RECORD: [Call; 1] = [qv(
            "walk record walk/policy.onnx --terrain yard/truth.glb --friction tiles=0.18 --friction gravel=0.45 --seed 2 --room 1 --walk 4 --minutes 10 --out record/walks",
        )];
        const RECORD_SMALL: [Call; 1] = [qv(
            "walk record walk/policy.onnx --terrain yard/truth.glb --friction tiles=0.18 --friction gravel=0.45 --seed 2 --room 1 --walk 4 --minutes 3.3 --out record/walks",
        )];
        const TUNE: [Call; 1] = [qv(
            "tune record/walks --policy walk/policy.onnx --terrain again/terrain.glb --train-on plane --params diagnose/calibrated.toml --out tune",
        )];
        const TUNE_SMALL: [Call; 1] = [qv(
            "tune record/walks --policy walk/policy.onnx --terrain again/terrain.glb --train-on plane --params diagnose/calibrated.toml --iterations 25 --out tune",
        )];
        const PATHS: [Call; 1] = [qv("walk paths walk/policy.onnx tune/policy.onnx --seed 2 --out paths/paths.json")];
        // The yard has nothing that hides a cone. Small: a minute or two on two cores.
        const NAVIGATE: [Call; 4] = [
            qv(
                "navigate train --scene reconstruct/scene.ply --terrain mesh/terrain.glb --starts view --distance 1.2,2.5 --camera none --rounds 3 --frames 1500 --robots 32 --epochs 8 --batch 2 --seed 1 --out navigate --json",
            ),
            remarks(
                "navigate test navigate/weights.bin --scene reconstruct/scene.ply --terrain mesh/terrain.glb --starts view --distance 1.2,2.5 --camera none --episodes 32 --seed 2 --out navigate/results.json",
                "navigate/said.txt",
            ),
            // The same policy on the tuned robot, in the simulator that was made like the recorded one.
            remarks(
                "navigate test navigate/weights.bin --scene reconstruct/scene.ply --terrain mesh/terrain.glb --starts view --distance 1.2,2.5 --camera none --episodes 32 --seed 2 --walk tune/policy.onnx --params tune/compensator.json --out navigate/walked.json",
                "navigate/said_walked.txt",
            ),
            qv("navigate page navigate/results.json --beside navigate/walked.json --out navigate/index.html"),
        ];
        const VIEW: [Call; 1] = [qv("view diagnose again reconstruct --out view/view.html")];
        const REPORT: [Call; 1] = [qv(
            "report --view view/view.html --reconstruction reconstruct --terrain again/terrain.glb --contact again --replay replay --diagnosis diagnose --tuning tune --paths paths/paths.json --out report/report.html",
        )];
        const REPORT_NAVIGATE: [Call; 1] = [qv(
            "report --view view/view.html --reconstruction reconstruct --terrain again/terrain.glb --contact again --replay replay --diagnosis diagnose --tuning tune --paths paths/paths.json --navigation navigate --out report/report.html",
        )];
        let is_small = size == Size::Small;
        match self {
            Self::Yard => &YARD,
            Self::Recording => &RECORDING,
            Self::Inspect => &INSPECT,
            Self::Reconstruct if is_small => &RECONSTRUCT_SMALL,
            Self::Reconstruct => &RECONSTRUCT,
            Self::Mesh => &MESH,
            Self::Contact => &CONTACT,
            Self::Replay => &REPLAY,
            Self::Diagnose => &DIAGNOSE,
            Self::Again => &AGAIN,
            Self::Walk if is_small => &WALK_SMALL,
            Self::Walk => &WALK,
            Self::Record if is_small => &RECORD_SMALL,
            Self::Record => &RECORD,
            Self::Tune if is_small => &TUNE_SMALL,
            Self::Tune => &TUNE,
            Self::Paths => &PATHS,
            Self::Navigate => &NAVIGATE,
            Self::View => &VIEW,
            Self::Report if navigate => &REPORT_NAVIGATE,
            Self::Report => &REPORT,
        }
    }

    /// Files and folders that it reads, relative to the pipeline's folder; `navigate` as in [`Stage::calls`].
    pub fn inputs(self, navigate: bool) -> Vec<&'static str> {
        let mut all = self.usual_inputs().to_vec();
        if navigate && self == Self::Report {
            all.extend(["navigate/results.json", "navigate/index.html"]);
        }
        all
    }

    fn usual_inputs(self) -> &'static [&'static str] {
        const POLICY: [&str; 3] = ["walk/policy.onnx", "walk/policy.toml", "walk/checkpoint.bin"];
        const RUNS: [&str; 2] = ["recording/tiles/run.mcap", "recording/gravel/run.mcap"];
        match self {
            Self::Yard => &[],
            Self::Recording => &["yard/truth.glb"],
            Self::Inspect => &RUNS,
            Self::Reconstruct => &["yard/transforms.json", "yard/points.ply", "yard/images", "yard/labels"],
            Self::Mesh => &["reconstruct/scene.ply", "yard/transforms.json", "yard/labels.toml", "yard/truth.glb"],
            Self::Contact => &[RUNS[0], RUNS[1], "mesh/terrain.glb"],
            Self::Replay | Self::Diagnose => &[RUNS[0], "contact/terrain.glb"],
            Self::Again => &[RUNS[0], RUNS[1], "mesh/terrain.glb", "diagnose/calibrated.toml"],
            Self::Walk => &[],
            Self::Record => &[POLICY[0], POLICY[1], POLICY[2], "yard/truth.glb"],
            Self::Tune => {
                &[POLICY[0], POLICY[1], POLICY[2], "record/walks", "again/terrain.glb", "diagnose/calibrated.toml"]
            }
            Self::Paths => {
                &[POLICY[0], POLICY[1], POLICY[2], "tune/policy.onnx", "tune/policy.toml", "tune/checkpoint.bin"]
            }
            Self::Navigate => &[
                "reconstruct/scene.ply",
                "mesh/terrain.glb",
                "tune/policy.onnx",
                "tune/policy.toml",
                "tune/checkpoint.bin",
                "tune/compensator.json",
            ],
            Self::View => &[
                "diagnose/report.json",
                "diagnose/calibrated.toml",
                "again/contact.json",
                "again/terrain.glb",
                "reconstruct/scene.ply",
                RUNS[0],
            ],
            Self::Report => &[
                "view/view.html",
                "tune/tune.json",
                "paths/paths.json",
                "reconstruct/metrics.json",
                "reconstruct/held_out",
                "again/contact.json",
                "again/terrain.glb",
                "replay/replay.json",
                "diagnose/report.json",
            ],
        }
    }

    /// Files and folders that it writes, relative to the pipeline's folder.
    pub fn outputs(self) -> &'static [&'static str] {
        match self {
            Self::Yard => &[
                "yard/transforms.json",
                "yard/points.ply",
                "yard/images",
                "yard/labels",
                "yard/depth",
                "yard/labels.toml",
                "yard/truth.glb",
            ],
            Self::Recording => &[
                "recording/tiles/run.mcap",
                "recording/tiles/truth.json",
                "recording/gravel/run.mcap",
                "recording/gravel/truth.json",
            ],
            Self::Inspect => &["inspect/tiles.json", "inspect/gravel.json"],
            Self::Reconstruct => &["reconstruct/scene.ply", "reconstruct/metrics.json", "reconstruct/held_out"],
            Self::Mesh => &["mesh/terrain.glb", "mesh/mesh.json"],
            Self::Contact => {
                &["contact/contact.json", "contact/contact.html", "contact/calibrated.toml", "contact/terrain.glb"]
            }
            Self::Replay => &["replay/replay.json", "replay/replay.mcap", "replay/replay.html"],
            Self::Diagnose => &["diagnose/report.json", "diagnose/report.html", "diagnose/calibrated.toml"],
            Self::Again => &["again/contact.json", "again/contact.html", "again/calibrated.toml", "again/terrain.glb"],
            Self::Walk => &["walk/policy.onnx", "walk/policy.toml", "walk/checkpoint.bin", "walk/walk.html"],
            Self::Record => &["record/walks"],
            Self::Tune => &[
                "tune/policy.onnx",
                "tune/policy.toml",
                "tune/checkpoint.bin",
                "tune/compensator.json",
                "tune/compensator.onnx",
                "tune/tune.json",
                "tune/tune.html",
            ],
            Self::Paths => &["paths/paths.json"],
            Self::Navigate => &[
                "navigate/weights.bin",
                "navigate/policy.onnx",
                "navigate/metrics.json",
                "navigate/said.txt",
                "navigate/results.json",
                "navigate/said_walked.txt",
                "navigate/walked.json",
                "navigate/index.html",
            ],
            Self::View => &["view/view.html"],
            Self::Report => &["report/report.html"],
        }
    }
}

impl Call {
    /// The arguments one by one.
    pub fn arguments(&self) -> Vec<String> {
        self.words.split_whitespace().map(String::from).collect()
    }

    /// Where its standard output goes, below the pipeline's folder.
    pub fn said_in(&self, folder: &std::path::Path) -> Option<PathBuf> {
        self.said.map(|file| folder.join(file))
    }
}
