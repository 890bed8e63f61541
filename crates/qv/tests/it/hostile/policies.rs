//! Policies whose graphs ask for all memory, or never end: they run in a process of their own.

use super::bounded;
use crate::bags::directory;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// A field of a protocol buffer with its length before it.
fn field(number: u8, contents: &[u8]) -> Vec<u8> {
    [vec![number << 3 | 2], varint(contents.len() as u64), contents.to_vec()].concat()
}

fn number(field: u64, value: u64) -> Vec<u8> {
    [field << 3, value].into_iter().flat_map(varint).collect()
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut out = vec![];
    while value >= 128 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
    out
}

fn node(inputs: &[&str], output: &str, operator: &str, attributes: &[Vec<u8>]) -> Vec<u8> {
    let inputs: Vec<u8> = inputs.iter().flat_map(|name| field(1, name.as_bytes())).collect();
    let attributes: Vec<u8> = attributes.iter().flat_map(|attribute| field(5, attribute)).collect();
    field(1, &[inputs, field(2, output.as_bytes()), field(4, operator.as_bytes()), attributes].concat())
}

/// A constant of whole numbers (`kind` 7) or floats (1).
fn constant(name: &str, dims: &[u64], kind: u64, raw: &[u8]) -> Vec<u8> {
    let dims: Vec<u8> = dims.iter().flat_map(|&size| number(1, size)).collect();
    field(5, &[dims, number(2, kind), field(8, name.as_bytes()), field(9, raw)].concat())
}

fn value(name: &str, width: u64) -> Vec<u8> {
    let shape: Vec<u8> = [1, width].iter().flat_map(|&size| field(1, &number(1, size))).collect();
    let kind = field(1, &[number(1, 1), field(2, &shape)].concat());
    [field(1, name.as_bytes()), field(2, &kind)].concat()
}

fn model(parts: &[Vec<u8>]) -> Vec<u8> {
    let graph = [parts.concat(), field(11, &value("obs", 45)), field(12, &value("act", 12))].concat();
    [number(1, 8), field(7, &graph), field(8, &number(2, 13))].concat()
}

/// The observation with something added whose mean is taken of what `begin` makes of itself under the name `big`.
fn adding(begin: &[Vec<u8>]) -> Vec<u8> {
    let integers = |values: &[i64]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let flat = [field(1, b"keepdims"), number(3, 0), number(20, 2)].concat();
    let mut parts = begin.to_vec();
    parts.push(node(&["big"], "mean", "ReduceMean", &[flat]));
    parts.push(node(&["obs", "s0", "s1", "s2"], "twelve", "Slice", &[]));
    parts.push(node(&["twelve", "mean"], "act", "Add", &[]));
    for (name, at) in [("s0", 0), ("s1", 12), ("s2", 1)] {
        parts.push(constant(name, &[1], 7, &integers(&[at])));
    }
    model(&parts)
}

fn graphs() -> Vec<(&'static str, Vec<u8>)> {
    let integers = |values: &[i64]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let shape = constant("n", &[2], 7, &integers(&[300_000, 300_000]));
    let range = [("from", 0.0f32), ("to", 1e12), ("step", 0.001)];
    let range: Vec<Vec<u8>> = range.map(|(name, x)| constant(name, &[], 1, &floats(&[x]))).to_vec();
    let tile = vec![
        constant("one", &[1, 1], 1, &floats(&[1.0])),
        constant("n", &[2], 7, &integers(&[300_000, 300_000])),
        node(&["one", "n"], "big", "Tile", &[]),
    ];
    // One step of the body is short; there are 2^62 of them.
    let body = {
        let boolean = |name: &str| {
            [field(1, name.as_bytes()), field(2, &field(1, &[number(1, 9), field(2, &[])].concat()))].concat()
        };
        let count = [field(1, b"i"), field(2, &field(1, &[number(1, 7), field(2, &[])].concat()))].concat();
        [
            node(&["again"], "then", "Identity", &[]),
            node(&["x"], "y", "Identity", &[]),
            field(2, b"b"),
            field(11, &count),
            field(11, &boolean("again")),
            field(11, &value("x", 45)),
            field(12, &boolean("then")),
            field(12, &value("y", 45)),
        ]
        .concat()
    };
    let attribute = [field(1, b"body"), field(6, &body), number(20, 5)].concat();
    let endless = vec![
        node(&["times", "yes", "obs"], "big", "Loop", &[attribute]),
        constant("times", &[], 7, &integers(&[1 << 62])),
        constant("yes", &[], 9, &[1]),
    ];
    vec![
        ("shape.onnx", adding(&[shape, node(&["n"], "big", "ConstantOfShape", &[])])),
        ("range.onnx", adding(&[range, vec![node(&["from", "to", "step"], "big", "Range", &[])]].concat())),
        ("tile.onnx", adding(&tile)),
        ("loop.onnx", adding(&endless)),
    ]
}

const DESCRIPTION: &str = include_str!("../../../../qv-go2/descriptions/rl_sar_go2.toml");

fn roll(policy: &Path, description: &Path) -> (i32, String) {
    let paths = [policy, description].map(|path| path.to_str().unwrap());
    let (code, _, err) = bounded(&["walk", "roll", paths[0], "--description", paths[1], "--seconds", "0.1"]);
    (code, err)
}

#[test]
fn graphs_that_ask_for_everything_are_refused() {
    let folder = directory("hostile_onnx");
    let description = folder.join("policy.toml");
    fs::write(&description, DESCRIPTION).unwrap();
    for (name, bytes) in graphs() {
        let path = folder.join(name);
        fs::write(&path, bytes).unwrap();
        let begun = Instant::now();
        let (checked, _, err) = bounded(&["check", path.to_str().unwrap()]);
        assert!([0, 1].contains(&checked), "{name}: {err}");
        let (code, err) = roll(&path, &description);
        assert_eq!(code, 1, "{name}: {err}");
        assert!(begun.elapsed().as_secs() < 100, "{name}");
    }
}

#[test]
fn an_honest_policy_runs_there_as_well() {
    let folder = directory("honest_onnx");
    let description = folder.join("policy.toml");
    fs::write(&description, DESCRIPTION).unwrap();
    let zero = 0f32.to_le_bytes();
    let path = folder.join("honest.onnx");
    fs::write(&path, adding(&[constant("big", &[1], 1, &zero)])).unwrap();
    let (code, err) = roll(&path, &description);
    assert_eq!(code, 0, "{err}");
}
