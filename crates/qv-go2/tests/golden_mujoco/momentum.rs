//! Energy and angular momentum of a state, from the poses of the links alone: link velocities are central differences
//! along the motion, so that nothing here leans on the dynamics that are being tested.

use glam::{DMat3, DQuat, DVec3};
use qv_core::Pose;
use qv_sim::{Model, State};

/// What free flight keeps.
pub struct Invariants {
    /// J
    pub kinetic_energy: f64,
    /// About the centre of mass, world axes \[kg m²/s\].
    pub angular_momentum: DVec3,
}

/// Half of the time span of the differences \[s\]: errors are its square, and rounding over it, both near 1e-10.
const HALF_SPAN: f64 = 1e-5;

/// Positions after following the velocities of a free-base state for a short time.
fn advanced(state: &State, time: f64) -> Vec<f64> {
    let mut q = state.q.clone();
    for i in 0..3 {
        q[i] += time * state.v[i];
    }
    let rotation = DQuat::from_xyzw(q[4], q[5], q[6], q[3]);
    let turned = rotation * DQuat::from_scaled_axis(time * DVec3::new(state.v[3], state.v[4], state.v[5]));
    (q[3], q[4], q[5], q[6]) = (turned.w, turned.x, turned.y, turned.z);
    for joint in 0..q.len() - 7 {
        q[7 + joint] += time * state.v[6 + joint];
    }
    q
}

/// Energy and momentum of a free-base state.
pub fn invariants(model: &Model, state: &State) -> Invariants {
    let now = model.world_from_links(&state.q);
    let before = model.world_from_links(&advanced(state, -HALF_SPAN));
    let after = model.world_from_links(&advanced(state, HALF_SPAN));
    let com = |poses: &[Pose], link: usize| poses[link].transform_point(model.links[link].com);
    let velocity = |link: usize| (com(&after, link) - com(&before, link)) / (2.0 * HALF_SPAN);
    let links = 0..model.links.len();
    let centre = links.clone().map(|l| model.links[l].mass * com(&now, l)).sum::<DVec3>() / model.mass();
    let drift = links.clone().map(|l| model.links[l].mass * velocity(l)).sum::<DVec3>() / model.mass();
    let mut found = Invariants { kinetic_energy: 0.0, angular_momentum: DVec3::ZERO };
    for link in links {
        let spin = (after[link].rotation * before[link].rotation.conjugate()).to_scaled_axis() / (2.0 * HALF_SPAN);
        let rotation: DMat3 = now[link].matrix();
        let turning = rotation * (model.links[link].inertia * (rotation.transpose() * spin));
        let (mass, moving) = (model.links[link].mass, velocity(link));
        found.kinetic_energy += 0.5 * (mass * moving.length_squared() + spin.dot(turning));
        found.angular_momentum += turning + mass * (com(&now, link) - centre).cross(moving - drift);
    }
    found
}
