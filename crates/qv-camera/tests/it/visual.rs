//! A camera with something hidden, in the yard: named, sized, and nothing accused where nothing is.

use crate::facts::States;
use crate::footage::{HiddenError, Recording, Truth, error, recording, yard};
use qv_camera::{Footage, Look, LookOptions, check, look};
use qv_core::{GaussianCloud, JointSeries};
use qv_gap::decision::{Policy, decide_camera};
use qv_gap::report::{Sight, Verdict};
use std::sync::OnceLock;

/// Small, so that it takes seconds without optimisation: `examples/sealed_cameras.rs` has the real sizes.
fn truth() -> &'static Truth {
    static TRUTH: OnceLock<Truth> = OnceLock::new();
    TRUTH.get_or_init(|| yard(14, 160, 120, 0.04, 3))
}

fn options() -> LookOptions<'static> {
    LookOptions { width: 120, ..Default::default() }
}

fn looked(hidden: HiddenError) -> Look {
    let recording = recording(truth(), hidden, 9);
    look(&recording.footage(&truth().cloud), &options()).unwrap()
}

fn decided(look: &Look) -> Sight {
    Sight::new(&look.evidence, &decide_camera(&look.evidence, &Policy::default()))
}

fn named(hidden: HiddenError, tolerance: f64) -> Look {
    let look = looked(hidden);
    let sight = decided(&look);
    let names: Vec<&str> = sight.causes.iter().map(|c| c.effect.as_str()).collect();
    assert_eq!(names, [hidden.name()], "{hidden:?} {} {:?}", sight.sentence, sight.evidence);
    let off = error(hidden, &sight.causes[0]);
    assert!(off < tolerance, "{hidden:?} off by {off}: {:?}", sight.causes[0].parameters);
    assert!(sight.gap.after < sight.gap.before && sight.gap.floor < sight.gap.after, "{:?}", sight.gap);
    assert!(sight.causes[0].closed_alone > 0.1 && sight.gap.heldout);
    look
}

#[test]
fn a_camera_as_stated_is_not_accused() {
    let look = looked(HiddenError::Nothing);
    let sight = decided(&look);
    assert!(sight.causes.is_empty() && sight.verdict == Verdict::NoGap, "{} {:?}", sight.sentence, sight.evidence);
    assert_eq!(sight.ranking[0].effect, "none");
    assert_eq!(look.corrected, recording(truth(), HiddenError::Nothing, 9).rig);
}

#[test]
fn a_delay_is_named_and_the_corrected_camera_has_none() {
    let hidden = HiddenError::Delay(0.06);
    let Look { corrected, pictures, .. } = named(hidden, 0.01);
    assert!(pictures.len() == 3 && pictures[0].photograph.len() == 3 * pictures[0].width * pictures[0].height);
    let mut again = recording(truth(), hidden, 9);
    again.rig = corrected;
    let sight = decided(&look(&again.footage(&truth().cloud), &options()).unwrap());
    assert!(sight.causes.is_empty(), "{}", sight.sentence);
}

#[test]
fn a_turned_camera_is_named() {
    named(HiddenError::Extrinsics([0.0, 0.01, 0.0, 0.03, -0.01, 0.01]), 0.3f64.to_radians());
}

#[test]
fn an_exposure_is_named() {
    named(HiddenError::Exposure(-0.9), 0.3);
}

#[test]
fn a_scene_that_lies_elsewhere_is_no_effect_of_the_camera() {
    let recording = recording(truth(), HiddenError::Nothing, 9);
    let mut shifted = truth().cloud.clone();
    shifted.means.iter_mut().for_each(|m| m[0] += 0.09);
    let sight = decided(&look(&recording.footage(&shifted), &options()).unwrap());
    assert!(sight.causes.is_empty() && sight.verdict == Verdict::Unexplained, "{} {:?}", sight.sentence, sight.level);
    assert!(sight.cannot_tell[0].states("0.09 0.09"), "{:?}", sight.cannot_tell);
}

#[test]
fn a_scene_of_another_place_is_said_to_be_one() {
    let recording = recording(truth(), HiddenError::Nothing, 9);
    let mut other = truth().cloud.clone();
    // The same surfaces with the colours of others.
    let step = 7919 % other.sh.len();
    other.sh.rotate_left(step);
    let sight = decided(&look(&recording.footage(&other), &options()).unwrap());
    assert!(sight.causes.is_empty() && sight.verdict == Verdict::Unexplained, "{} {:?}", sight.sentence, sight.level);
    assert!(sight.cannot_tell[0].states("place"), "{:?}", sight.cannot_tell);
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let recording = recording(truth(), HiddenError::Delay(0.04), 2);
    let photographs = &recording.photographs[..6];
    let footage = Footage { photographs, ..recording.footage(&truth().cloud) };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| look(&footage, &LookOptions { width: 64, ..Default::default() }).unwrap())
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn bad_inputs_are_named() {
    let good = recording(truth(), HiddenError::Nothing, 1);
    let fails = |footage: &Footage, words: &[&str]| {
        for error in [check(footage, &options()).unwrap_err(), look(footage, &options()).unwrap_err()] {
            let error = error.to_string();
            assert!(words.iter().all(|w| error.contains(w)), "{error}");
        }
    };
    let footage = good.footage(&truth().cloud);
    fails(&Footage { photographs: &[], ..footage }, &["images", "0 of 0"]);
    fails(&Footage { poses: None, ..footage }, &["base pose"]);
    let late = JointSeries::new(vec![100.0, 101.0], [1.0; 14].to_vec(), 7).unwrap();
    fails(&Footage { poses: Some(&late), ..footage }, &["images", "0 of 14"]);
    let mut small: Recording = recording(truth(), HiddenError::Nothing, 1);
    small.photographs[3].rgba.pop();
    fails(&small.footage(&truth().cloud), &["image size", "160 x 120"]);
    let mut elsewhere: GaussianCloud = truth().cloud.clone();
    elsewhere.means.iter_mut().for_each(|m| m[2] += 500.0);
    fails(&Footage { cloud: &elsewhere, ..footage }, &["scene", "in view"]);
    let mut blind = footage;
    blind.rig.intrinsics.fx = 0.0;
    fails(&blind, &["camera", "fx"]);
}
