//! What a recording says of feet, against what the simulated robot did.

use crate::strips::{go2, mesh, prepared, run};
use qv_contact::measured::{Recording, TICK, difference, heading};
use qv_contact::simulate::Simulator;
use qv_contact::{Ground, segments, windows};

#[test]
fn feet_stand_where_the_robot_is_and_slip_on_ice() {
    let (model, ground) = (go2(), Ground::new(&mesh()).unwrap());
    let terrain = ground.terrain(&[0.6, 0.6]).unwrap();
    let simulator = Simulator::new(run(), &model, &terrain, &[]).unwrap();
    let recording = Recording::new(run(), simulator.rollout(), &ground).unwrap();
    let [first, last] = run().span();
    let ticks = ((last - first) / TICK).floor() as usize;
    assert!((ticks - 6..=ticks).contains(&recording.instants.len()), "{} of {ticks}", recording.instants.len());
    // Standing feet on each side of the edge at x = 0.45 m, counted here from their places.
    let mut expected = [0.0, 0.0];
    for foot in recording.instants.iter().flatten().flat_map(|instant| &instant.feet).filter(|foot| foot.stands) {
        expected[usize::from(foot.sole.x > 0.45)] += TICK;
        assert!(foot.sole.z.abs() < 0.02, "a standing foot is on the plane: {foot:?}");
    }
    let found = recording.contact_time(2);
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} {expected:?}");
    assert!(found.iter().all(|time| *time > 4.0), "{found:?}");
    let slips = recording.slips(7);
    let share = |label: usize| slips.iter().filter(|slip| slip.label == label).count() as f64 * TICK / found[label];
    assert!(share(0) > 1.15 * share(1) && share(0) > 0.05, "{} {}", share(0), share(1));
    assert!(
        slips.iter().all(|slip| slip.run == 7 && slip.distance > 0.006 && (slip.at[0] > 0.45) == (slip.label == 1))
    );
}

#[test]
fn windows_and_segments_cover_the_recording_once() {
    let (model, ground) = (go2(), Ground::new(&mesh()).unwrap());
    let (_, recordings) = prepared(&model, &ground, &[0.5, 0.5]);
    let all = windows::cut(&recordings, &[], usize::MAX);
    assert!(all.windows(2).all(|pair| pair[1].from >= pair[0].from + windows::TICKS), "they do not overlap");
    let away = windows::cut(&recordings, &[(0, 100, 140)], usize::MAX);
    assert!(away.len() < all.len() && away.iter().all(|w| w.from + windows::TICKS <= 100 || w.from >= 140));
    let few = windows::cut(&recordings, &[], 20);
    assert!(few.len() == 20 && few.iter().all(|window| all.contains(window)));
    let counts = windows::counts(&all);
    let touching = |label: usize| all.iter().filter(|w| w.labels.contains(&label)).count();
    assert!((0..2).all(|label| counts[&label] == touching(label)));
    let cut = segments::cut(&recordings, 2.0);
    assert!(cut.len() >= 7 && cut.iter().all(|s| s.ticks == 40), "{}", cut.len());
    assert!(cut.windows(2).all(|pair| pair[1].from >= pair[0].from + 40));
    assert!(cut.iter().enumerate().all(|(k, s)| s.held_out == (k % 3 == 2)), "every third is held out");
}

/// A base turned about the vertical axis: errors forward and left turn with it.
#[test]
fn differences_are_seen_from_the_robot() {
    let (model, ground) = (go2(), Ground::new(&mesh()).unwrap());
    let (_, recordings) = prepared(&model, &ground, &[0.5, 0.5]);
    let state = recordings[0].instants.iter().flatten().nth(50).unwrap().state.clone();
    let mut ahead = state.clone();
    let yaw = heading(&state);
    (ahead.q[0], ahead.q[1]) = (ahead.q[0] + 0.02 * yaw.cos(), ahead.q[1] + 0.02 * yaw.sin());
    ahead.v[6] += 0.3;
    let apart = difference(&ahead, &state, yaw);
    assert!((apart[0] - 0.02).abs() < 1e-12 && apart[1].abs() < 1e-12, "{apart:?}");
    assert_eq!(apart.len(), 12 + 2 * 12);
    assert!((apart[24] - 0.3).abs() < 1e-12 && apart[12..24].iter().all(|x| *x == 0.0));
}
