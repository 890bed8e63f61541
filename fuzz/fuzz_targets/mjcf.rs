#![no_main]
use libfuzzer_sys::fuzz_target;
use qv_sim::mjcf::MjcfModel;
use qv_sim::{BaseKind, Batch, ModelOptions, SimOptions, Terrain};

fuzz_target!(|data: &[u8]| {
    let text = String::from_utf8_lossy(data);
    for base in [BaseKind::Fixed, BaseKind::Floating] {
        let options = ModelOptions { base, ..Default::default() };
        let Ok(read) = MjcfModel::read(&text, &options, &|_| Ok(text.to_string())) else { continue };
        let model = read.model;
        // What was read can be set on the ground and moved; a state that runs away is marked, never NaN.
        if model.joints.len() > 20 {
            continue;
        }
        let Ok(mut robot) = Batch::<f64>::new(&model, &Terrain::plane(), &SimOptions::default(), 1) else { continue };
        robot.step_many(2);
        let state = robot.state(0).expect("environment 0 exists");
        assert!(state.q.iter().chain(&state.v).all(|x| x.is_finite()), "{state:?}");
    }
});
