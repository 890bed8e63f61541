//! A file is whole whatever ends it.

use qv_go2::messages::{LowState, encode_low_state};
use qv_live::{Recent, Recorder, Sample, Subscription, subscriptions};
use qv_recording::mapping::Mapping;
use qv_recording::{BagFile, Run, read_bag};
use std::cell::RefCell;
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::rc::Rc;

fn go2() -> (Mapping, Vec<Subscription>, usize) {
    let mapping = qv_recording::robots::built_in("go2").unwrap().mapping;
    let all = subscriptions(&mapping, &[]).unwrap();
    let state = all.iter().position(|s| s.topic == "/lowstate").unwrap();
    (mapping, all, state)
}

fn sample(subscription: usize, k: u32) -> Sample {
    let q = std::array::from_fn(|j| 0.1 * (0.01 * f64::from(k) + j as f64).sin());
    let data = encode_low_state(&LowState { q, tick: 2 * k, quaternion: [1.0, 0.0, 0.0, 0.0], ..Default::default() });
    let received = 1_700_000_000_000_000_000 + 2_000_000 * u64::from(k);
    Sample { subscription, received, sent: None, writer: 1, sequence: i64::from(k), data }
}

fn read(bytes: Vec<u8>, mapping: &Mapping) -> Run {
    read_bag(vec![BagFile { name: "live".into(), source: Cursor::new(bytes) }], mapping).unwrap()
}

fn rows(run: &Run) -> usize {
    run.measured.position.as_ref().map_or(0, |p| p.len())
}

/// A file whose bytes stay when its writer is gone.
#[derive(Clone, Default)]
struct Disk(Rc<RefCell<Cursor<Vec<u8>>>>);

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.borrow_mut().seek(to)
    }
}

#[test]
fn what_is_recorded_is_read_as_it_was_sent() {
    let (mapping, all, state) = go2();
    let mut recorder = Recorder::new(Cursor::new(Vec::new()), &all).unwrap();
    (0..2000).for_each(|k| recorder.write(&sample(state, k)).unwrap());
    let run = read(recorder.finish().unwrap().into_inner(), &mapping);
    assert_eq!(rows(&run), 2000);
    assert!(run.lost.is_empty(), "{:?}", run.lost);
    let position = run.measured.position.as_ref().unwrap();
    assert!((position.row(1500)[4] - 0.1 * (15.0_f64 + 4.0).sin()).abs() < 1e-6);
}

#[test]
fn a_recorder_that_is_killed_leaves_all_but_the_last_second() {
    let (mapping, all, state) = go2();
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone(), &all).unwrap();
    (0..2600).for_each(|k| recorder.write(&sample(state, k)).unwrap());
    // As after a kill or a power cut: nothing of the end is written.
    std::mem::forget(recorder);
    let bytes = disk.0.borrow().get_ref().clone();
    let run = read(bytes, &mapping);
    assert!((2100..=2600).contains(&rows(&run)), "{} of 2600 states are left", rows(&run));
    assert!(!run.lost.is_empty(), "that the end is missing is said");
}

#[test]
fn the_last_seconds_are_a_run_and_a_flood_takes_no_memory() {
    let (mapping, all, state) = go2();
    let mut recent = Recent::new(2.0, 1 << 20);
    (0..5000).for_each(|k| recent.push(sample(state, k)));
    let kept = recent.len();
    // A megabyte of messages of 1180 bytes.
    assert!((800..=890).contains(&kept), "{kept}");
    assert_eq!(rows(&recent.to_run(&all, &mapping).unwrap()), kept);
    assert!(Recent::new(2.0, 1 << 20).to_run(&all, &mapping).is_err(), "of nothing there is no run");
}
