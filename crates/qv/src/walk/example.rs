//! A walk that nobody walked, for tests: the Go2's links, legs that swing as sines show.

use qv_policy::play::WalkTrace;
use qv_policy::policy::PolicyFile;
use qv_policy::ppo::Iteration;
use qv_policy::score::Score;
use qv_policy::train::Line;
use qv_policy::velocity::{Randomise, TaskSettings};
use std::f32::consts::TAU;

/// `steps` decisions of a trot at 2 Hz and 0.5 m/s, 50 decisions a second; every swing lasts 0.24 s and lifts a foot by 5 cm.
pub fn made_up(steps: usize) -> WalkTrace {
    let robot = qv_go2::walk::robot().unwrap();
    let geoms = &robot.model.geoms;
    let mut played = WalkTrace {
        rate: 50.0,
        joints: robot.model.joint_names().to_vec(),
        feet: robot.feet.iter().map(|&g| geoms[g].name.clone()).collect(),
        links: robot.model.links.iter().map(|l| l.name.clone()).collect(),
        parents: robot.model.links.iter().map(|l| l.parent).collect(),
        foot_links: robot.feet.iter().map(|&g| geoms[g].link).collect(),
        foot_radii: robot.feet.iter().map(|&g| robot.foot_radius(g)).collect(),
        efforts: robot.model.joints.iter().map(|j| Some(j.effort as f32)).collect(),
        mass: robot.model.mass() as f32,
        height: robot.height,
        ..Default::default()
    };
    for k in 0..steps {
        let time = k as f32 / 50.0;
        let mut q = vec![0.5 * time, 0.0, robot.height, 1.0, 0.0, 0.0, 0.0];
        q.extend(robot.stand.iter().enumerate().map(|(j, a)| a + 0.1 * (2.0 * TAU * time + j as f32).sin()));
        let wide: Vec<f64> = q.iter().map(|&x| f64::from(x)).collect();
        let links = robot.model.world_from_links(&wide);
        // A foot's step within its cycle of 25: it is in the air for the last 12.
        let phase = |foot: usize| (k + if foot == 0 || foot == 3 { 0 } else { 12 }) % 25;
        let height = |foot: usize| match phase(foot) {
            step @ 13.. => 0.05 * ((step - 12) as f32 * TAU / 26.0).sin(),
            _ => 0.0,
        };
        let centre = |(foot, &g): (usize, &usize)| {
            let at = (links[geoms[g].link] * geoms[g].link_from_geom).position;
            [at.x as f32, at.y as f32, height(foot) + robot.foot_radius(g)]
        };
        played.commands.push([0.5, 0.0, 0.1]);
        played.velocity.push([0.48, 0.01, 0.0]);
        played.turning.push([0.0, 0.0, 0.12]);
        played.dq.push(vec![1.0; robot.joints()]);
        played.torques.push((0..robot.joints()).map(|j| 5.0 * (2.0 * TAU * time + j as f32).sin()).collect());
        played.targets.push(q[7..].iter().map(|a| a - 0.1).collect());
        played.foot_forces.push((0..4).map(|foot| if phase(foot) < 13 { 75.0 } else { 0.0 }).collect());
        played.foot_peaks.push((0..4).map(|foot| if phase(foot) < 13 { 75.0 } else { 0.0 }).collect());
        played.foot_heights.push((0..4).map(height).collect());
        played.foot_positions.push(robot.feet.iter().enumerate().map(centre).collect());
        played.link_positions.push(links.iter().map(|p| p.position.to_array().map(|x| x as f32)).collect());
        played.q.push(q);
    }
    played
}

/// Lines of a training: a score each 20 iterations, no episode ends in the first four.
pub fn lines(count: u64) -> Vec<Line> {
    let line = |k: u64| Line {
        iteration: Iteration {
            index: k,
            reward: 0.01 * k as f32,
            std: 1.0 / (1 + k) as f32,
            rate: 1e-3,
            ends: if k < 4 { [0, 0] } else { [1, 3] },
            ..Default::default()
        },
        samples: 6144 * (k + 1),
        figures: vec![("velocity", 1.2), ("velocity_error", 0.2), ("turning_error", 0.3)],
        score: (k + 1).is_multiple_of(20).then(|| Score { robots: 64, velocity_error: 0.1, ..Default::default() }),
    };
    (0..count).map(line).collect()
}

/// The file of a policy that was trained for the Go2.
pub fn file() -> PolicyFile {
    let settings = TaskSettings { randomise: Randomise::robust("base"), ..Default::default() };
    PolicyFile::new(&qv_go2::walk::robot().unwrap(), &settings, "plane", None)
}
