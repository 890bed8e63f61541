//! ONNX files whose weights lie in a file beside them, as torch's exporter writes them.

use qv_policy::onnx::{Numbers, OnnxModel, external_files};

fn field(number: u8, inner: &[u8]) -> Vec<u8> {
    [&[number << 3 | 2, u8::try_from(inner.len()).unwrap()], inner].concat()
}

fn integer(number: u8, value: u8) -> Vec<u8> {
    vec![number << 3, value]
}

/// `y = x + w` of two numbers; w lies in `w.data`.
fn model() -> Vec<u8> {
    let node = [field(1, b"x"), field(1, b"w"), field(2, b"y"), field(4, b"Add")].concat();
    let entry = |key: &[u8], value: &[u8]| field(13, &[field(1, key), field(2, value)].concat());
    let external = [entry(b"location", b"w.data"), entry(b"offset", b"0"), entry(b"length", b"8")].concat();
    let tensor = [integer(1, 2), integer(2, 1), field(8, b"w"), external, integer(14, 1)].concat();
    let shape = field(2, &field(1, &integer(1, 2)));
    let value = |name: &[u8]| [field(1, name), field(2, &field(1, &[integer(1, 1), shape.clone()].concat()))].concat();
    let graph = [field(1, &node), field(2, b"g"), field(5, &tensor), field(11, &value(b"x")), field(12, &value(b"y"))];
    [integer(1, 8), field(7, &graph.concat()), field(8, &integer(2, 17))].concat()
}

#[test]
fn weights_beside_the_model_are_named_and_read() {
    let bytes = model();
    assert_eq!(external_files(&bytes).unwrap().into_iter().collect::<Vec<_>>(), ["w.data"]);
    assert!(OnnxModel::from_bytes(&bytes).is_err(), "weights are missing");
    let weights: Vec<u8> = [0.5f32, -2.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let read = OnnxModel::with_files(&bytes, &[("w.data".to_string(), weights)]).unwrap();
    assert_eq!(read.run(&[("x", Numbers::Floats(&[1.0, 2.0]))], &["y"]).unwrap(), [[1.5, 0.0]]);
    assert!(external_files(b"PK\x03\x04").is_err());
}
