//! Real tosses of a cube, where the data is there, and the reader of their table.

use crate::facts::States;
use crate::skipped::skipped;

use crate::tosses::{Cube, Toss, errors, mean, parse, simulate, turning_convention};

const CUBE: Cube = Cube { edge: 0.1048, mass: 0.37, inertia: 0.00081 };

/// Measured 12.1 mm at friction 0.18, 27.5 mm at 0.22, neutral contact otherwise. Nothing is fitted but the starts.
#[test]
fn real_tosses_are_reproduced() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/real/cube_tosses/tosses.csv");
    let Ok(text) = std::fs::read_to_string(path) else {
        skipped("no ../shared/real/cube_tosses beside the workspace");
        return;
    };
    let tosses = parse(&text).unwrap();
    let (in_box, in_world) = turning_convention(&tosses);
    assert!(in_box < 0.1 * in_world, "angular velocities are not in box axes: {in_box} against {in_world} rad/s");
    let model = CUBE.model().unwrap();
    let fitted = |toss: &Toss| toss.start_fitted(&toss.samples[..toss.flight(&CUBE, 0.003, 10)]);
    let starts: Vec<_> = tosses.iter().map(fitted).collect();
    let found = [0.1, 0.18, 0.22].map(|friction| {
        let paths = simulate(&model, &tosses, &starts, &[("contact.friction", friction)]).unwrap();
        mean(&errors(&tosses, &paths))
    });
    println!("mean error at friction 0.10, 0.18, 0.22: {found:?} m");
    assert!(found[1] < 0.014, "{} m", found[1]);
    assert!(found[1] < found[0] && found[1] < found[2], "{found:?}");
}

const HEADER: &str = "toss,time,x,y,z,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz\n";

/// A table of one toss in free fall, turning about a tilted axis, written exactly.
fn table(samples: usize) -> String {
    let turning = glam::DVec3::new(2.0, -1.0, 3.0);
    let mut text = HEADER.to_owned();
    for k in 0..samples {
        let t = 0.01 * k as f64;
        let q = glam::DQuat::from_rotation_x(0.4) * glam::DQuat::from_scaled_axis(turning * t);
        let (z, vz) = (1.0 + 0.5 * t - 0.5 * 9.81 * t * t, 0.5 - 9.81 * t);
        text += &format!("3,{t},{},0,{z},{},{},{},{},1,0,{vz},2,-1,3\n", 0.1 + t, q.w, q.x, q.y, q.z);
    }
    text
}

#[test]
fn a_start_is_found_from_poses_and_leads_along_the_path() {
    let tosses = parse(&table(12)).unwrap();
    assert_eq!((tosses.len(), tosses[0].number, tosses[0].samples.len()), (1, 3, 12));
    let (in_box, in_world) = turning_convention(&tosses);
    assert!(in_box < 1e-6 && in_world > 0.1, "{in_box} {in_world}");
    let flight = tosses[0].flight(&CUBE, 0.003, 10);
    assert_eq!(flight, 10);
    let (written, fitted) = (tosses[0].start_as_written(), tosses[0].start_fitted(&tosses[0].samples[..flight]));
    for (a, b) in written.q.iter().chain(&written.v).zip(fitted.q.iter().chain(&fitted.v)) {
        assert!((a - b).abs() < 1e-9, "{written:?} {fitted:?}");
    }
    let paths = simulate(&CUBE.model().unwrap(), &tosses, &[fitted], &[]).unwrap();
    assert!(mean(&errors(&tosses, &paths)) < 1e-3);
}

#[test]
fn bad_tables_are_refused_by_line() {
    let refused = |text: &str, part: &str| {
        let error = parse(text).unwrap_err();
        assert!(error.contains(part), "{error}");
    };
    refused("", "empty");
    refused("toss,time\n", "column `x`");
    refused(HEADER, "found none");
    refused(&table(3), "toss 3");
    refused(&table(5).replace("3,0.02,", "3,nan,"), "line 4");
    refused(&table(5).replace("3,0.02,", "3,0.005,"), "line 4");
    refused(&(table(5) + "4,0,1"), "line 7");
    refused(&(table(5) + "4,0,0,0,0,0,0,0,0,0,0,0,0,0,0\n"), "quaternion");
    let uneven = parse(&table(6).replace("3,0.02,", "3,0.024,")).unwrap();
    let starts = [uneven[0].start_as_written()];
    assert!(simulate(&CUBE.model().unwrap(), &uneven, &starts, &[]).unwrap_err().states("sample 2"));
}
