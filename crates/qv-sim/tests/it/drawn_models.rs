//! Batches of drawn models, and models whose indices lead nowhere.

use crate::drawn::step;
use qv_sim::{BaseKind, Batch, Model, ModelOptions, SimOptions, Terrain};

#[test]
fn drawn_models_step_in_batches() {
    let mut seed = 1u64;
    let mut robots = 0;
    for _ in 0..150 {
        let bytes: Vec<u8> = (0..400)
            .map(|_| {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (seed >> 56) as u8
            })
            .collect();
        robots += usize::from(step(&bytes));
    }
    assert!(robots > 50, "only {robots} of 150 were robots");
}

#[test]
fn models_whose_indices_lead_nowhere_are_refused() {
    let text = "<robot name='r'><link name='a'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>\
        </inertial></link><link name='b'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>\
        <collision><geometry><sphere radius='0.1'/></geometry></collision></link><joint name='j' type='revolute'><parent link='a'/>\
        <child link='b'/><axis xyz='0 1 0'/><limit lower='-1' upper='1' effort='1' velocity='1'/></joint></robot>";
    let good = Model::from_urdf(text, &ModelOptions { base: BaseKind::Floating, ..Default::default() }).unwrap();
    let is_taken = |model: &Model| Batch::<f64>::new(model, &Terrain::plane(), &SimOptions::default(), 1).is_ok();
    assert!(is_taken(&good));
    let changes: [fn(&mut Model); 8] = [
        |m| m.geoms[0].link = 2,
        |m| m.links[1].parent = Some(1),
        |m| m.links[1].parent = Some(9),
        |m| m.links[1].joint = Some(1),
        |m| m.links[1].joint = None,
        |m| m.links[0].joint = Some(0),
        |m| drop(m.joints.pop()),
        |m| m.base = BaseKind::Fixed,
    ];
    for (k, change) in changes.iter().enumerate() {
        let mut model = good.clone();
        change(&mut model);
        assert!(!is_taken(&model), "change {k}");
    }
}
