//! Recordings of a simulated Go2, and its model.

use qv_go2::synthetic::{self, Message, Robot};
use qv_recording::{BagFile, Run};
use qv_sim::{BaseKind, Model, ModelOptions, Terrain};
use std::io::Cursor;

/// A recording of a Go2 with small differences of its own and parameters that are `named`.
pub fn recorded(named: Vec<(String, f64)>, seed: u64) -> Run {
    let parameters = [synthetic::small_differences(seed), named].concat();
    read(&synthetic::record(&Terrain::plane(), &Robot { parameters, seed, start: [0.0; 3] }).unwrap())
}

/// What a bag of messages holds.
pub fn read(messages: &[Message]) -> Run {
    let mut bytes = Cursor::new(Vec::new());
    synthetic::write_bag(messages, &mut bytes).unwrap();
    bytes.set_position(0);
    qv_recording::read_bag(vec![BagFile { name: "made up".into(), source: bytes }], &qv_go2::wire::mapping(None))
        .unwrap()
}

/// The nominal Go2.
pub fn go2() -> Model {
    let options = ModelOptions { base: BaseKind::Floating, armature: qv_go2::model::ARMATURE, ..Default::default() };
    Model::from_urdf(&qv_go2::model::urdf(), &options).unwrap()
}
