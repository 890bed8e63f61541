//! The ONNX file of the network gives what the network gives: pictures of 640 x 480 bytes, several decisions in a row, in onnxruntime.

use qv_core::random::Xoshiro256PlusPlus;
use qv_nav::net::{HEIGHT, HIDDEN, Net, NetInput, OUTPUTS, SIGHT, STATE, WIDTH};
use qv_nav::onnx::{POOL, to_bytes};
use qv_nav::recall::RECALL;
use qv_nav::task::Limits;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs the model over decisions in a row; the memory goes round. Frames are a file of bytes, states one of floats.
const SCRIPT: &str = "
import json, sys
import numpy as np, onnxruntime
session = onnxruntime.InferenceSession(sys.argv[1], providers=['CPUExecutionProvider'])
frames = np.fromfile(sys.argv[2], np.uint8).reshape(-1, 1, 480, 640, 3)
states = np.fromfile(sys.argv[3], np.float32).reshape(-1, 1, 6)
recalls = np.fromfile(sys.argv[4], np.float32).reshape(len(frames), 1, -1)
memory, rows = np.zeros((1, 192), np.float32), []
names = ['command', 'shares', 'cone', 'sight', 'next_memory']
for frame, state, recall in zip(frames, states, recalls):
    *said, memory = session.run(names, dict(frame=frame, state=state, recall=recall, memory=memory))
    rows.append([x for part in said for x in part[0].tolist()])
json.dump(rows, sys.stdout)
";

fn python() -> Option<PathBuf> {
    let candidate = std::env::var_os("QV_PYTHON_ONNX").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let works = Command::new(&candidate).args(["-c", "import numpy, onnxruntime"]).output();
    works.ok().filter(|output| output.status.success()).map(|_| candidate)
}

#[test]
fn onnxruntime_decides_the_same() {
    let Some(python) = python() else {
        crate::skipped::skipped("no Python with numpy and onnxruntime (cargo xtask test makes one)");
        return;
    };
    let (net, limits) = (Net::default(), Limits::default());
    let mut random = Xoshiro256PlusPlus::new(4);
    let mut parameters = net.draw(&mut random);
    // Outputs of a size at which errors would be seen.
    parameters.iter_mut().for_each(|p| *p *= 1.3);
    let (mut scratch, mut memory) = (net.scratch(), vec![0.0; HIDDEN]);
    let (mut frames, mut states, mut recalls, mut expected) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for _ in 0..12 {
        let frame: Vec<u8> = (0..POOL * POOL * WIDTH * HEIGHT * 3).map(|_| random.below(256) as u8).collect();
        let mut picture = vec![0.0f32; WIDTH * HEIGHT * 3];
        for (k, &byte) in frame.iter().enumerate() {
            let (row, column, channel) = (k / (3 * POOL * WIDTH), k / 3 % (POOL * WIDTH), k % 3);
            picture[(row / POOL * WIDTH + column / POOL) * 3 + channel] += f32::from(byte) / (POOL * POOL) as f32;
        }
        let state: Vec<f32> = (0..STATE).map(|_| random.normal()).collect();
        let recall: Vec<f32> = (0..RECALL).map(|_| 0.5 * random.normal()).collect();
        let sees = NetInput { picture: &picture, state: &state, recall: &recall };
        let says = net.step(&parameters, &sees, &mut memory, &mut scratch);
        let command = limits.command([says.out[0], says.out[1], says.out[2]]);
        let numbers = says.out[..OUTPUTS].iter().chain(&says.sight).map(|x| f64::from(*x));
        expected.push(command.into_iter().chain(numbers).collect::<Vec<f64>>());
        recalls.extend(recall.iter().flat_map(|x| x.to_le_bytes()));
        frames.extend(frame);
        states.extend(state.iter().flat_map(|x| x.to_le_bytes()));
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("nav_onnx");
    std::fs::create_dir_all(&folder).unwrap();
    let at = |name: &str| folder.join(name);
    std::fs::write(at("policy.onnx"), to_bytes(&net, &parameters, &limits, [3.0, 2.5]).unwrap()).unwrap();
    std::fs::write(at("frames"), frames).unwrap();
    std::fs::write(at("states"), states).unwrap();
    std::fs::write(at("recalls"), recalls).unwrap();
    let arguments = [at("policy.onnx"), at("frames"), at("states"), at("recalls")];
    let output = Command::new(python).args(["-c", SCRIPT]).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Vec<Vec<f64>> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found.len(), expected.len());
    for (step, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(found.len(), 10 + SIGHT);
        for (k, (a, b)) in found.iter().zip(expected).enumerate() {
            assert!((a - b).abs() < 1e-5, "decision {step}, number {k}: {a} for {b}");
        }
    }
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    let net = Net::default();
    let parameters = vec![f32::NAN; net.len()];
    let error = to_bytes(&net, &parameters, &Limits::default(), [3.0; 2]).unwrap_err().to_string();
    assert!(error.contains("conv_0"), "{error}");
}
