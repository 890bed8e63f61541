//! ONNX files that we write: read by a parser of the test's own, by the interpreter, and by onnxruntime.

use crate::facts::States;
use qv_policy::onnx::{Dense, OnnxError, PolicyGraph};
use std::collections::HashMap;

/// Numbers of a linear congruential generator (Knuth), in -1 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn list(&mut self, count: usize, scale: f32) -> Vec<f32> {
        (0..count).map(|_| scale * self.next()).collect()
    }
}

/// A policy of 45 inputs, layers of 64 and 32, and 12 outputs.
struct TestPolicy {
    offset: Vec<f32>,
    scale: Vec<f32>,
    weights: Vec<Vec<f32>>,
    bias: Vec<Vec<f32>>,
    output_scale: Vec<f32>,
    output_offset: Vec<f32>,
    lower: Vec<f32>,
    upper: Vec<f32>,
    metadata: Vec<(String, String)>,
}

const WIDTHS: [usize; 4] = [45, 64, 32, 12];

impl TestPolicy {
    fn new() -> Self {
        let mut random = Random(7);
        Self {
            offset: random.list(45, 0.5),
            scale: random.list(45, 2.0),
            weights: WIDTHS.windows(2).map(|w| random.list(w[0] * w[1], 0.3)).collect(),
            bias: WIDTHS[1..].iter().map(|&width| random.list(width, 0.5)).collect(),
            output_scale: random.list(12, 0.5),
            output_offset: random.list(12, 1.0),
            lower: vec![-0.8; 12],
            upper: vec![0.6; 12],
            metadata: vec![("kp".into(), "25".into()), ("robot".into(), "go2 \u{e9}".into())],
        }
    }

    fn layers(&self) -> Vec<Dense<'_>> {
        (0..3)
            .map(|k| Dense {
                weights: &self.weights[k],
                bias: &self.bias[k],
                inputs: WIDTHS[k],
                outputs: WIDTHS[k + 1],
                elu: k < 2,
            })
            .collect()
    }

    fn graph<'a>(&'a self, layers: &'a [Dense<'a>]) -> PolicyGraph<'a> {
        PolicyGraph {
            input: "observation",
            output: "targets",
            offset: &self.offset,
            scale: &self.scale,
            layers,
            output_scale: &self.output_scale,
            output_offset: &self.output_offset,
            lower: &self.lower,
            upper: &self.upper,
            metadata: &self.metadata,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        self.graph(&self.layers()).to_bytes().unwrap()
    }

    /// The policy by its definition, in double precision.
    fn evaluate(&self, observation: &[f32]) -> Vec<f64> {
        let mut x: Vec<f64> =
            (0..45).map(|i| f64::from(observation[i] - self.offset[i]) * f64::from(self.scale[i])).collect();
        for k in 0..3 {
            x = (0..WIDTHS[k + 1])
                .map(|o| {
                    let row = &self.weights[k][o * WIDTHS[k]..(o + 1) * WIDTHS[k]];
                    let sum: f64 = row.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum();
                    let y = sum + f64::from(self.bias[k][o]);
                    if k < 2 && y < 0.0 { y.exp_m1() } else { y }
                })
                .collect();
        }
        (0..12)
            .map(|i| {
                let y = f64::from(self.output_offset[i]) + f64::from(self.output_scale[i]) * x[i];
                y.clamp(f64::from(self.lower[i]), f64::from(self.upper[i]))
            })
            .collect()
    }
}

fn observations(count: usize) -> Vec<Vec<f32>> {
    let mut random = Random(11);
    (0..count).map(|_| random.list(45, 2.0)).collect()
}

fn near(found: &[f32], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((f64::from(*a) - b).abs() <= tolerance, "output {i}: {a}, expected {b}");
    }
}

/// Fields of a protobuf message: number, and bytes or a varint.
enum Field<'a> {
    Integer(u64),
    Bytes(&'a [u8]),
    Float(f32),
}

fn varint(bytes: &mut &[u8]) -> u64 {
    let mut value = 0;
    for shift in (0..70).step_by(7) {
        let byte = bytes[0];
        *bytes = &bytes[1..];
        value |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
        if byte < 0x80 {
            return value;
        }
    }
    panic!("a varint of more than ten bytes")
}

fn fields(mut bytes: &[u8]) -> Vec<(u64, Field<'_>)> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let tag = varint(&mut bytes);
        let field = match tag & 7 {
            0 => Field::Integer(varint(&mut bytes)),
            2 => {
                let length = varint(&mut bytes) as usize;
                let (value, rest) = bytes.split_at(length);
                bytes = rest;
                Field::Bytes(value)
            }
            5 => {
                let (value, rest) = bytes.split_at(4);
                bytes = rest;
                Field::Float(f32::from_le_bytes(value.try_into().unwrap()))
            }
            other => panic!("wire type {other}"),
        };
        found.push((tag >> 3, field));
    }
    found
}

fn all<'a>(bytes: &'a [u8], number: u64) -> Vec<&'a [u8]> {
    let matching = |(found, field): (u64, Field<'a>)| match field {
        Field::Bytes(value) if found == number => Some(value),
        _ => None,
    };
    fields(bytes).into_iter().filter_map(matching).collect()
}

fn texts(bytes: &[u8], number: u64) -> Vec<String> {
    all(bytes, number).into_iter().map(|text| String::from_utf8(text.to_vec()).unwrap()).collect()
}

fn integer(bytes: &[u8], number: u64) -> u64 {
    let matching = |(found, field): &(u64, Field)| match field {
        Field::Integer(value) if *found == number => Some(*value),
        _ => None,
    };
    fields(bytes).iter().find_map(matching).unwrap()
}

/// Runs the graph of a file for one observation, knowing the operators that a policy is made of.
fn interpret(file: &[u8], observation: &[f32]) -> Vec<f32> {
    let graph = all(file, 7)[0];
    let mut values: HashMap<String, Vec<f32>> = HashMap::new();
    for tensor in all(graph, 5) {
        let numbers = all(tensor, 9)[0].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        values.insert(texts(tensor, 8)[0].clone(), numbers);
    }
    values.insert(texts(all(graph, 11)[0], 1)[0].clone(), observation.to_vec());
    for node in all(graph, 1) {
        let input: Vec<&Vec<f32>> = texts(node, 1).iter().map(|name| &values[name]).collect();
        let pairs = |f: fn(f32, f32) -> f32| input[0].iter().zip(input[1]).map(|(a, b)| f(*a, *b)).collect();
        let operator = &texts(node, 4)[0];
        let result: Vec<f32> = match operator.as_str() {
            "Sub" => pairs(|a, b| a - b),
            "Mul" => pairs(|a, b| a * b),
            "Add" => pairs(|a, b| a + b),
            "Max" => pairs(f32::max),
            "Min" => pairs(f32::min),
            "Elu" => {
                let alpha = fields(all(node, 5)[0]).into_iter().find_map(|(number, field)| match field {
                    Field::Float(value) if number == 2 => Some(value),
                    _ => None,
                });
                assert_eq!(alpha, Some(1.0));
                input[0].iter().map(|x| if *x < 0.0 { x.exp_m1() } else { *x }).collect()
            }
            "Gemm" => {
                let attribute = all(node, 5)[0];
                assert_eq!((texts(attribute, 1)[0].as_str(), integer(attribute, 3)), ("transB", 1));
                let rows = input[1].chunks_exact(input[0].len());
                rows.zip(input[2])
                    .map(|(row, b)| row.iter().zip(input[0]).map(|(w, x)| w * x).sum::<f32>() + b)
                    .collect()
            }
            "Identity" => input[0].clone(),
            other => panic!("operator {other}"),
        };
        values.insert(texts(node, 2)[0].clone(), result);
    }
    values[&texts(all(graph, 12)[0], 1)[0]].clone()
}

#[test]
fn a_parser_of_its_own_reads_the_same_policy() {
    let made = TestPolicy::new();
    let file = made.bytes();
    let mut clipped = 0;
    for observation in observations(50) {
        let expected = made.evaluate(&observation);
        clipped += expected.iter().filter(|y| **y == f64::from(-0.8_f32) || **y == f64::from(0.6_f32)).count();
        near(&interpret(&file, &observation), &expected, 2e-5);
    }
    assert!((20..580).contains(&clipped), "{clipped} of 600 outputs at a bound: the test must see both");
}

#[test]
fn the_file_says_what_it_is() {
    let made = TestPolicy::new();
    let file = made.bytes();
    assert_eq!(integer(&file, 1), 8, "IR version");
    assert_eq!(integer(all(&file, 8)[0], 2), 13, "operator set");
    let pairs: Vec<[String; 2]> =
        all(&file, 14).into_iter().map(|entry| [texts(entry, 1)[0].clone(), texts(entry, 2)[0].clone()]).collect();
    let expected: Vec<[String; 2]> = made.metadata.iter().map(|(key, value)| [key.clone(), value.clone()]).collect();
    assert_eq!(pairs, expected);
    let graph = all(&file, 7)[0];
    for (number, name, width) in [(11, "observation", 45), (12, "targets", 12)] {
        let info = all(graph, number)[0];
        assert_eq!(texts(info, 1), [name]);
        let tensor = all(all(info, 2)[0], 1)[0];
        let dimensions = all(all(tensor, 2)[0], 1);
        assert_eq!((integer(tensor, 1), dimensions.len()), (1, 2));
        assert_eq!((texts(dimensions[0], 2), integer(dimensions[1], 1)), (vec!["n".to_owned()], width));
    }
}

#[test]
fn what_is_wrong_is_named() {
    let made = TestPolicy::new();
    let layers = made.layers();
    let refused = |change: &dyn Fn(&mut PolicyGraph)| {
        let mut graph = made.graph(&layers);
        change(&mut graph);
        graph.to_bytes().unwrap_err().to_string()
    };
    assert_eq!(refused(&|graph| graph.layers = &[]), "layers: expected at least 1, found 0");
    assert_eq!(refused(&|graph| graph.offset = &[0.0; 44]), "offset: expected 45 numbers, found 44");
    assert_eq!(refused(&|graph| graph.upper = &[f32::NAN; 12]), "upper: expected finite numbers, found NaN at index 0");
    let inverted = refused(&|graph| graph.upper = &[-0.9; 12]);
    assert_eq!(inverted, "bounds of output 0: expected lower <= upper, found -0.8 > -0.9");
    assert!(refused(&|graph| graph.output = "observation").contains("`observation`"));
    assert!(refused(&|graph| graph.input = "").states("empty"));
    let with = |change: &dyn Fn(&mut [Dense])| {
        let mut layers = made.layers();
        change(&mut layers);
        made.graph(&layers).to_bytes().unwrap_err().to_string()
    };
    assert_eq!(with(&|layers| layers[1].inputs = 63), "inputs of layer 1: expected 64 numbers, found 63");
    assert_eq!(with(&|layers| layers[2].bias = &[0.0; 11]), "bias of layer 2: expected 12 numbers, found 11");
    assert_eq!(with(&|layers| layers[0].outputs = 0), "width of a layer: expected at least 1, found 0");
    let infinite = vec![f32::INFINITY; 45 * 64];
    let mut layers = made.layers();
    layers[0].weights = &infinite;
    let error = made.graph(&layers).to_bytes().unwrap_err();
    assert!(matches!(error, OnnxError::NotFinite { index: 0, .. }), "{error}");
}

mod python {
    use super::{TestPolicy, near, observations};
    use std::path::{Path, PathBuf};
    use std::process::Command;

    /// The Python of an environment with the packages, when the test runner made one.
    pub fn python() -> Option<PathBuf> {
        let candidate = std::env::var_os("QV_PYTHON_ONNX").map_or_else(|| PathBuf::from("python3"), PathBuf::from);
        let works = Command::new(&candidate).args(["-c", "import numpy, onnxruntime"]).output();
        let found = works.ok().filter(|output| output.status.success()).map(|_| candidate);
        if found.is_none() {
            crate::skipped::skipped("no Python with numpy and onnxruntime (cargo xtask test makes one)");
        }
        found
    }

    /// What onnxruntime says for inputs by name, each with rows; one list of rows per output.
    pub fn onnxruntime(python: &Path, name: &str, file: &[u8], inputs: &serde_json::Value) -> serde_json::Value {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let (model, rows) = (folder.join(format!("{name}.onnx")), folder.join(format!("{name}.json")));
        std::fs::write(&model, file).unwrap();
        std::fs::write(&rows, inputs.to_string()).unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/onnx/run_model.py");
        let output = Command::new(python).arg(script).arg(model).arg(rows).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    pub fn row(value: &serde_json::Value) -> Vec<f32> {
        value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect()
    }

    #[test]
    fn onnxruntime_reads_the_same_policy() {
        let Some(python) = python() else { return };
        let made = TestPolicy::new();
        let rows = observations(20);
        let found = onnxruntime(&python, "policy", &made.bytes(), &serde_json::json!({ "observation": rows }));
        assert_eq!(found["metadata"]["robot"], "go2 \u{e9}");
        assert_eq!(found["shapes"]["observation"], serde_json::json!(["n", 45]));
        let outputs = found["outputs"]["targets"].as_array().unwrap();
        assert_eq!(outputs.len(), 20);
        for (observation, output) in rows.iter().zip(outputs) {
            near(&row(output), &made.evaluate(observation), 1e-5);
        }
    }
}

/// Operators beside those of a plain policy, against their definitions.
mod recurrent {
    use super::Random;
    use qv_policy::onnx::{GraphBuilder, Gru, OnnxError};

    const INPUTS: usize = 5;
    const HIDDEN: usize = 4;

    pub struct Cell {
        input_weights: Vec<f32>,
        state_weights: Vec<f32>,
        input_bias: Vec<f32>,
        state_bias: Vec<f32>,
    }

    impl Cell {
        pub fn new() -> Self {
            let mut random = Random(3);
            Self {
                input_weights: random.list(3 * HIDDEN * INPUTS, 0.8),
                state_weights: random.list(3 * HIDDEN * HIDDEN, 0.8),
                input_bias: random.list(3 * HIDDEN, 0.5),
                state_bias: random.list(3 * HIDDEN, 0.5),
            }
        }

        /// Next state; the action is `tanh` of its first two numbers beside the input's last three.
        pub fn step(&self, x: &[f32], state: &[f32]) -> Vec<f64> {
            let product = |weights: &[f32], bias: &[f32], x: &[f32], row: usize| -> f64 {
                let row_of_weights = &weights[row * x.len()..(row + 1) * x.len()];
                let sum: f64 = row_of_weights.iter().zip(x).map(|(w, x)| f64::from(*w) * f64::from(*x)).sum();
                sum + f64::from(bias[row])
            };
            let input = |row| product(&self.input_weights, &self.input_bias, x, row);
            let recurrent = |row| product(&self.state_weights, &self.state_bias, state, row);
            let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
            (0..HIDDEN)
                .map(|i| {
                    let z = sigmoid(input(i) + recurrent(i));
                    let r = sigmoid(input(HIDDEN + i) + recurrent(HIDDEN + i));
                    let h = (input(2 * HIDDEN + i) + r * recurrent(2 * HIDDEN + i)).tanh();
                    (1.0 - z) * h + z * f64::from(state[i])
                })
                .collect()
        }

        pub fn file(&self) -> Result<Vec<u8>, OnnxError> {
            let mut graph = GraphBuilder::new();
            let x = graph.input("x", INPUTS)?;
            let state = graph.input("state_in", HIDDEN)?;
            let gru = Gru {
                inputs: INPUTS,
                hidden: HIDDEN,
                input_weights: &self.input_weights,
                state_weights: &self.state_weights,
                input_bias: &self.input_bias,
                state_bias: &self.state_bias,
            };
            let next = graph.gru("cell", &gru, &x, &state)?;
            let head = graph.slice(&next, 0, 2)?;
            let head = graph.tanh(&head);
            let tail = graph.slice(&x, 2, 5)?;
            let action = graph.concat(&[&head, &tail]);
            graph.output(&action, "action", 5)?;
            graph.output(&next, "state_out", HIDDEN)?;
            Ok(graph.finish())
        }

        pub fn action(x: &[f32], next: &[f64]) -> Vec<f64> {
            next[..2].iter().map(|h| h.tanh()).chain(x[2..].iter().map(|x| f64::from(*x))).collect()
        }
    }

    #[test]
    fn onnxruntime_steps_the_same_cell() {
        let Some(python) = super::python::python() else { return };
        let cell = Cell::new();
        let mut random = Random(5);
        let (x, state) = (random.list(INPUTS, 1.0), random.list(HIDDEN, 1.0));
        let inputs = serde_json::json!({ "x": [x], "state_in": [state] });
        let found = super::python::onnxruntime(&python, "gru", &cell.file().unwrap(), &inputs);
        let next = cell.step(&x, &state);
        super::near(&super::python::row(&found["outputs"]["state_out"][0]), &next, 1e-6);
        super::near(&super::python::row(&found["outputs"]["action"][0]), &Cell::action(&x, &next), 1e-6);
    }

    #[test]
    fn a_cell_of_the_wrong_size_is_refused() {
        let mut cell = Cell::new();
        cell.input_bias.pop();
        assert_eq!(cell.file().unwrap_err().to_string(), "cell, bias of inputs: expected 12 numbers, found 11");
        let mut graph = GraphBuilder::new();
        let x = graph.input("x", 3).unwrap();
        assert!(matches!(graph.slice(&x, 2, 2), Err(OnnxError::Empty { .. })));
        assert!(matches!(graph.input("x", 3), Err(OnnxError::Name(name)) if name == "x"));
    }
}

#[cfg(feature = "onnx")]
mod interpreter {
    use super::recurrent::Cell;
    use super::{Random, TestPolicy, near, observations};
    use crate::facts::States;
    use qv_policy::onnx::{GraphBuilder, OnnxError, OnnxPolicy};

    #[test]
    fn a_policy_of_ours_is_run_as_it_is_defined() {
        let made = TestPolicy::new();
        let mut policy = OnnxPolicy::from_bytes(&made.bytes()).unwrap();
        assert_eq!(
            (policy.inputs()[0].name.as_str(), &policy.inputs()[0].shape),
            ("observation", &vec![None, Some(45)])
        );
        assert_eq!((policy.outputs()[0].name.as_str(), &policy.outputs()[0].shape), ("targets", &vec![None, Some(12)]));
        let mut out = vec![9.0; 3];
        for observation in observations(50) {
            policy.run(&observation, &mut out).unwrap();
            near(&out, &made.evaluate(&observation), 2e-5);
        }
    }

    #[test]
    fn a_recurrent_state_goes_from_step_to_step() {
        let cell = Cell::new();
        let mut policy = OnnxPolicy::from_bytes(&cell.file().unwrap()).unwrap();
        let mut random = Random(5);
        let (mut out, mut first) = (Vec::new(), Vec::new());
        let mut state = vec![0.0_f32; 4];
        let start = random.list(5, 1.0);
        for step in 0..10 {
            let x = if step == 0 { start.clone() } else { random.list(5, 1.0) };
            policy.run(&x, &mut out).unwrap();
            let next = cell.step(&x, &state);
            near(&out, &Cell::action(&x, &next), 1e-5);
            state = next.iter().map(|h| *h as f32).collect();
            if step == 0 {
                first.clone_from(&out);
            }
        }
        policy.reset();
        policy.run(&start, &mut out).unwrap();
        assert_eq!(out, first, "a reset policy starts anew");
    }

    #[test]
    fn observations_of_the_wrong_length_and_numbers_that_are_none_are_named() {
        let made = TestPolicy::new();
        let mut policy = OnnxPolicy::from_bytes(&made.bytes()).unwrap();
        let mut out = Vec::new();
        let error = policy.run(&[0.0; 44], &mut out).unwrap_err().to_string();
        assert_eq!(error, "observation for input `observation`: expected 45 numbers, found 44");
        let mut observation = [0.0; 45];
        observation[3] = f32::NAN;
        let error = policy.run(&observation, &mut out).unwrap_err().to_string();
        assert_eq!(error, "observation: expected finite numbers, found NaN at index 3");
        // What overflows inside is an error, too: (3e38 - 0) * 10 is infinite.
        let mut graph = GraphBuilder::new();
        let x = graph.input("x", 2).unwrap();
        let ten = graph.constant("ten", &[1], &[10.0]).unwrap();
        let y = graph.mul(&x, &ten);
        graph.output(&y, "y", 2).unwrap();
        let mut policy = OnnxPolicy::from_bytes(&graph.finish()).unwrap();
        policy.run(&[1.0, 2.0], &mut out).unwrap();
        assert_eq!(out, [10.0, 20.0]);
        let error = policy.run(&[1.0, 3e38], &mut out).unwrap_err().to_string();
        assert_eq!(error, "output `y`: expected finite numbers, found inf at index 1");
        assert_eq!(out, [10.0, 20.0], "what was there before stays");
    }

    #[test]
    fn inputs_without_outputs_are_refused() {
        let mut graph = GraphBuilder::new();
        let x = graph.input("x", 2).unwrap();
        let y = graph.input("y", 2).unwrap();
        let sum = graph.add(&x, &y);
        graph.output(&sum, "sum", 2).unwrap();
        let error = OnnxPolicy::from_bytes(&graph.finish()).unwrap_err();
        assert!(matches!(error, OnnxError::Signature { .. }) && error.to_string().states("inputs"), "{error}");
    }

    /// Cut at every 97th byte, and with bytes changed: an error or numbers, never a panic.
    #[test]
    fn damaged_files_never_panic() {
        let file = TestPolicy::new().bytes();
        let mut out = Vec::new();
        let mut refused = 0;
        let mut try_it = |bytes: &[u8]| match OnnxPolicy::from_bytes(bytes) {
            Err(error) => {
                assert!(!error.to_string().is_empty());
                refused += 1;
            }
            Ok(mut policy) => drop(policy.run(&[0.1; 45], &mut out)),
        };
        for end in (0..file.len()).step_by(97) {
            try_it(&file[..end]);
        }
        let mut random = Random(13);
        for _ in 0..400 {
            let mut damaged = file.clone();
            for _ in 0..4 {
                // Mostly where the structure is: the last part of the file holds names and shapes.
                let share = 0.5 + 0.5 * random.next();
                let at = if random.next() < 0.0 { share * 1500.0 } else { share * (file.len() - 1) as f32 };
                damaged[(at as usize).min(file.len() - 1)] = (128.0 + 127.0 * random.next()) as u8;
            }
            try_it(&damaged);
        }
        assert!(refused > 200, "{refused} of the damaged files were refused");
    }
}
