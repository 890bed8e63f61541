//! A short training of the Go2 gives what it gave when it was looked at, and a policy far better than none.

use crate::facts::States;
use crate::short::{Figures, Golden, trained};

#[test]
fn a_short_training_gives_the_figures_of_its_golden() {
    let golden = Golden::read();
    let fresh = Golden::new(golden.figures.clone());
    assert_eq!(golden.name, "short");
    // A golden of other settings says nothing of these.
    assert_eq!(fresh, golden, "settings or tolerances are not the golden's: `cargo xtask golden bless short`");
    let trained = trained();
    println!("untrained {:?}\ntrained {:?}", trained.untrained, trained.figures);
    let differences = golden.differences(&trained.figures);
    assert!(differences.is_empty(), "not the golden's figures:\n  {}", differences.join("\n  "));
    let (before, after) = (&trained.untrained, &trained.score);
    assert!(after.velocity_error < 0.6 * before.velocity_error, "{before:?} {after:?}");
    assert!(after.turning_error < 0.6 * before.turning_error, "{before:?} {after:?}");
    assert!(after.swing_time > 2.0 * before.swing_time, "{before:?} {after:?}");
}

#[test]
fn what_differs_from_a_golden_is_named() {
    let golden = Golden::read();
    assert_eq!(golden.differences(&golden.figures), Vec::<String>::new());
    let other = Figures { reward: f32::NAN, fell: golden.figures.fell + 9.0, ..golden.figures.clone() };
    let said = golden.differences(&other);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].states("0 9 +9") && said[1].contains("reward"), "{said:?}");
}
