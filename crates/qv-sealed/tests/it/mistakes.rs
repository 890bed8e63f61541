//! Conventions of commands: none is reported of recordings that are right, and each mistake is named first.

use qv_sealed::mistakes::{MISTAKES, Motors, ROBOTS, plant, record, reported};

#[test]
fn recordings_without_a_mistake_have_no_report() {
    for (k, kind) in ROBOTS.into_iter().cycle().take(9).enumerate() {
        let mut run = record(kind, Motors::default(), 500 + k as u64).unwrap();
        assert_eq!(reported(&mut run), [], "{} {k}", kind.name());
    }
}

#[test]
fn each_mistake_is_named_first() {
    let mut missed = Vec::new();
    for (k, mistake) in MISTAKES.into_iter().enumerate() {
        for (r, kind) in ROBOTS.into_iter().enumerate() {
            let size = (k + r) % 3;
            let mut planted = plant(kind, mistake, size, 900 + k as u64).unwrap();
            let reported = reported(&mut planted.run);
            if !planted.is_named_by(&reported) {
                missed.push((mistake, kind, size, reported));
            }
        }
    }
    // 95 % of 36.
    assert!(missed.len() <= 1, "{missed:?}");
}

#[test]
fn what_is_found_reads_the_commands_right() {
    for mistake in MISTAKES {
        let mut planted = plant(ROBOTS[1], mistake, 1, 4).unwrap();
        let before = reported(&mut planted.run);
        let mut fixed = qv_recording::commanded::fix(planted.run.clone());
        // Torques of another unit and commands that firmware shapes are no matter of one setting.
        if before.iter().any(|(_, detail)| detail.contains("--fix")) {
            assert_ne!(fixed.commands, planted.run.commands, "{mistake:?}");
            assert_eq!(reported(&mut fixed), [], "{mistake:?}");
        }
    }
}
