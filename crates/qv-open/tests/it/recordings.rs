//! Recordings from files: a table with its description, a bag in parts, and what is none.

use crate::files::{DESCRIPTION, PENDULUM, folder, pendulum_table};
use qv_go2::synthetic::{self, Robot};
use qv_open::{Reading, description_of, lost_from, model_of, open_run};
use qv_recording::RecordingError;
use qv_recording::run::Base;
use qv_sim::Terrain;
use std::cell::Cell;
use std::fs;
use std::path::Path;

#[test]
fn a_table_gives_the_numbers_that_were_written() {
    let folder = folder("table");
    let value = |k: u32| 0.4 * (0.03 * f64::from(k)).sin();
    fs::write(folder.join("run.csv"), pendulum_table(300, value)).unwrap();
    fs::write(folder.join("pendulum.urdf"), PENDULUM).unwrap();
    fs::write(folder.join("run.toml"), DESCRIPTION).unwrap();
    let bytes = Cell::new((0, 0));
    let run = open_run(&folder, &Reading::default(), &|done, total| bytes.set((done, total))).unwrap();
    assert!(bytes.get().0 == bytes.get().1 && bytes.get().1 > 3000, "all of the file was counted: {:?}", bytes.get());
    assert_eq!((run.base, run.joint_names.as_slice()), (Base::Fixed, &["hinge".to_string()][..]));
    let position = run.measured.position.as_ref().unwrap();
    assert!((0..300u32).all(|k| (position.row(k as usize)[0] - value(k)).abs() < 1e-12));
    assert!(lost_from(&run).is_empty());
    assert_eq!(description_of(&folder.join("run.csv")), folder.join("run.toml"));
    let model = model_of(&run, &folder, None).unwrap();
    assert!(
        (model.nq(), model.nv()) == (1, 1) && (model.links.iter().map(|l| l.mass).sum::<f64>() - 2.0).abs() < 1e-12
    );
    fs::remove_file(folder.join("pendulum.urdf")).unwrap();
    assert!(
        matches!(open_run(&folder, &Reading::default(), &|_, _| {}), Err(RecordingError::File { file, .. }) if file.ends_with("pendulum.urdf"))
    );
}

#[test]
fn a_bag_has_the_robot_and_the_time_that_were_recorded() {
    let folder = folder("bag");
    let robot = Robot { parameters: vec![], seed: 1, start: [0.0; 3] };
    let messages = synthetic::record(&Terrain::plane(), &robot).unwrap();
    let file = folder.join("run.mcap");
    synthetic::write_bag(&messages, fs::File::create(&file).unwrap()).unwrap();
    let run = open_run(&file, &Reading::default(), &|_, _| {}).unwrap();
    let [first, last] = run.span();
    assert!((last - first - synthetic::DURATION).abs() < 0.1, "{first} to {last}");
    assert!(run.base == Base::Free && run.joint_names.len() == 12 && lost_from(&run).is_empty());
    let model = model_of(&run, &file, None).unwrap();
    assert_eq!((model.nq(), model.joint_names().len()), (19, 12));
    let elsewhere = Reading { pose_topic: Some("/nowhere".into()), ..Reading::default() };
    assert!(open_run(&file, &elsewhere, &|_, _| {}).is_ok_and(|run| run.measured.base_pose.is_none()), "no such topic");
    assert!(model_of(&run, &file, Some("no_such_robot")).is_err());
}

#[test]
fn what_is_no_recording_is_refused_with_its_name() {
    let folder = folder("none");
    fs::write(folder.join("run.txt"), "t,q\n").unwrap();
    fs::write(folder.join("run.mcap"), "no bag").unwrap();
    for name in ["run.txt", "run.mcap", "missing.mcap", "missing.csv"] {
        let error = open_run(&folder.join(name), &Reading::default(), &|_, _| {}).err().unwrap();
        assert!(error.to_string().contains(name), "{error}");
    }
    assert!(open_run(Path::new(""), &Reading::default(), &|_, _| {}).is_err());
}
