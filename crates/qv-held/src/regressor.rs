//! Joint torques of a fixed-base tree as a linear function of its links' inertial parameters.
//!
//! Torque `Y(q, dq, ddq) pi` (Atkeson, An and Hollerbach, International Journal of Robotics Research 5, 1986). Parameters of a link are
//! about its modelled centre of mass and along its axes: a point mass there, first moments, and second moments `∫ x x' dm`. A point mass `m`
//! at `d` from the centre is `m`, `m d` and `m d d'`.

use glam::{DMat3, DVec3};
use qv_core::{GRAVITY, Pose};
use qv_sim::{JointKind, Model};

/// Parameters of a link: mass, first moments x, y, z, second moments xx, yy, zz, xy, xz, yz.
pub(crate) const INERTIAL: usize = 10;
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Inertial parameters of a point mass \[kg\] at `place` \[m\] from the centre of mass, link axes.
pub(crate) fn point_mass(mass: f64, place: DVec3) -> [f64; INERTIAL] {
    let mut all = [0.0; INERTIAL];
    all[0] = mass;
    (0..3).for_each(|k| all[1 + k] = mass * place[k]);
    PAIRS.iter().enumerate().for_each(|(n, &(i, k))| all[4 + n] = mass * place[i] * place[k]);
    all
}

/// Second moments of a body with a rotational inertia `I`: `tr(I) / 2 - I`.
pub(crate) fn second_moments(inertia: &DMat3) -> [f64; INERTIAL] {
    let half = 0.5 * (inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z);
    let mut all = [0.0; INERTIAL];
    for (n, &(i, k)) in PAIRS.iter().enumerate() {
        all[4 + n] = if i == k { half - inertia.col(k)[i] } else { -inertia.col(k)[i] };
    }
    all
}

/// Motion of a link in the world.
#[derive(Clone, Copy)]
struct Motion {
    pose: Pose,
    /// Angular velocity and acceleration.
    spin: DVec3,
    spin_rate: DVec3,
    /// Acceleration of the link's origin, that of gravity taken off.
    acceleration: DVec3,
}

fn motions(model: &Model, q: &[f64], v: &[f64], a: &[f64]) -> Vec<Motion> {
    let poses = model.world_from_links(q);
    let mut all: Vec<Motion> = Vec::with_capacity(poses.len());
    for (link, pose) in model.links.iter().zip(poses) {
        let still = Motion {
            pose: Pose::IDENTITY,
            spin: DVec3::ZERO,
            spin_rate: DVec3::ZERO,
            acceleration: GRAVITY * DVec3::Z,
        };
        let parent = link.parent.map_or(still, |p| all[p]);
        let mut own = Motion { pose, ..parent };
        let arm = pose.position - parent.pose.position;
        own.acceleration += parent.spin_rate.cross(arm) + parent.spin.cross(parent.spin.cross(arm));
        if let Some(j) = link.joint {
            let axis = pose.rotation * model.joints[j].axis;
            match model.joints[j].kind {
                JointKind::Revolute => {
                    own.spin += axis * v[j];
                    own.spin_rate += axis * a[j] + parent.spin.cross(axis) * v[j];
                }
                JointKind::Prismatic => own.acceleration += axis * a[j] + 2.0 * parent.spin.cross(axis) * v[j],
            }
        }
        all.push(own);
    }
    all
}

/// Force and moment about the link's origin that each inertial parameter of a link asks for, world axes.
fn wrenches(motion: &Motion, com: DVec3) -> [(DVec3, DVec3); INERTIAL] {
    let carried = |x: DVec3| motion.spin_rate.cross(x) + motion.spin.cross(motion.spin.cross(x));
    let axes: [DVec3; 3] = std::array::from_fn(|k| motion.pose.rotation * DVec3::AXES[k]);
    let centre = motion.pose.rotation * com;
    let mut all = [(DVec3::ZERO, DVec3::ZERO); INERTIAL];
    let force = motion.acceleration + carried(centre);
    all[0] = (force, centre.cross(force));
    for k in 0..3 {
        let turned = carried(axes[k]);
        all[1 + k] = (turned, axes[k].cross(force) + centre.cross(turned));
    }
    for (n, &(i, k)) in PAIRS.iter().enumerate() {
        let moment = axes[i].cross(carried(axes[k]));
        let other = if i == k { DVec3::ZERO } else { axes[k].cross(carried(axes[i])) };
        all[4 + n] = (DVec3::ZERO, moment + other);
    }
    all
}

/// Torque of each joint per inertial parameter of each link \[N m\], shape `[joints][links * 10]`; zero for links that a joint does not carry.
/// Positions \[rad\], speeds and accelerations of the joints, shape `[joints]`; gravity is 9.81 m/s² downwards.
pub(crate) fn torque_regressor(model: &Model, q: &[f64], v: &[f64], a: &[f64]) -> Vec<Vec<f64>> {
    let motions = motions(model, q, v, a);
    let mut all = vec![vec![0.0; INERTIAL * model.links.len()]; model.joints.len()];
    for (index, link) in model.links.iter().enumerate() {
        let wrenches = wrenches(&motions[index], link.com);
        let mut carrier = Some(index);
        while let Some(c) = carrier {
            if let Some(j) = model.links[c].joint {
                let axis = motions[c].pose.rotation * model.joints[j].axis;
                let arm = motions[index].pose.position - motions[c].pose.position;
                for (k, (force, moment)) in wrenches.iter().enumerate() {
                    all[j][INERTIAL * index + k] = match model.joints[j].kind {
                        JointKind::Revolute => axis.dot(*moment + arm.cross(*force)),
                        JointKind::Prismatic => axis.dot(*force),
                    };
                }
            }
            carrier = model.links[c].parent;
        }
    }
    all
}

/// The inertial parameters of a link as it is modelled.
pub(crate) fn modelled(model: &Model, link: usize) -> [f64; INERTIAL] {
    let mut all = second_moments(&model.links[link].inertia);
    all[0] = model.links[link].mass;
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_sim::{BaseKind, Batch, JointCommand, ModelOptions, Payload, SimOptions, State, Terrain};

    const URDF: &str = r#"<robot name="r"><link name="base"/>
      <link name="a"><inertial><origin xyz="0.2 0.03 -0.01"/><mass value="2"/>
        <inertia ixx="0.01" iyy="0.03" izz="0.025" ixy="0.002" ixz="-0.001" iyz="0.003"/></inertial></link>
      <link name="b"><inertial><origin xyz="0.1 -0.02 0.04"/><mass value="1"/>
        <inertia ixx="0.004" iyy="0.006" izz="0.007" ixy="0.001" ixz="0.0005" iyz="-0.001"/></inertial></link>
      <link name="c"><inertial><origin xyz="0.0 0.05 0.02"/><mass value="0.5"/>
        <inertia ixx="0.002" iyy="0.001" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.3" rpy="0.2 0 0.1"/>
        <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="50"/></joint>
      <joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0" rpy="0 0.3 0"/>
        <axis xyz="0.6 0 0.8"/><limit lower="-3" upper="3" effort="100" velocity="50"/></joint>
      <joint name="j3" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.2 0.1 0"/>
        <axis xyz="1 0 0"/><limit lower="-3" upper="3" effort="100" velocity="50"/></joint></robot>"#;

    /// Torques by which the simulator's acceleration in a state is what its regressor is asked with.
    fn state() -> ([f64; 3], [f64; 3], [f64; 3]) {
        ([0.4, -0.7, 0.1], [1.3, -2.0, 0.6], [7.0, -11.0, 4.0])
    }

    #[test]
    fn torques_move_the_simulated_robot_as_they_should() {
        let model = Model::from_urdf(URDF, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap();
        let (q, v, _) = state();
        let tau = [12.0, -3.0, 5.0];
        let options = SimOptions { timestep: 1e-6, ..Default::default() };
        let mut sim = Batch::<f64>::new(&model, &Terrain::none(), &options, 1).unwrap();
        sim.set_state(0, &State { q: q.to_vec(), v: v.to_vec() }).unwrap();
        let zero = [0.0; 3];
        sim.set_command(0, &JointCommand { q: &zero, dq: &zero, kp: &zero, kd: &zero, tau: &tau }).unwrap();
        sim.step();
        let a = sim.acceleration(0).unwrap();
        let pi: Vec<f64> = (0..3).flat_map(|l| modelled(&model, l)).collect();
        let asked = torque_regressor(&model, &q, &v, &a);
        for j in 0..3 {
            let found: f64 = asked[j].iter().zip(&pi).map(|(y, p)| y * p).sum();
            assert!((found - tau[j]).abs() < 1e-3, "joint {j}: {found} {}", tau[j]);
        }
    }

    #[test]
    fn a_point_mass_anywhere_is_what_the_model_with_it_asks_for() {
        let model = Model::from_urdf(URDF, &ModelOptions { base: BaseKind::Fixed, ..Default::default() }).unwrap();
        let (q, v, a) = state();
        let (mass, place) = (0.7, DVec3::new(0.05, -0.1, 0.2));
        let mut loaded = model.clone();
        let body = qv_sim::MassProperties { mass: 1.0, com: model.links[1].com, inertia: model.links[1].inertia };
        let with = Payload { mass, at: model.links[1].com + place, moment: DVec3::ZERO }.on(&body);
        (loaded.links[1].mass, loaded.links[1].com, loaded.links[1].inertia) = (with.mass, with.com, with.inertia);
        let torque = |m: &Model, extra: Option<[f64; INERTIAL]>| -> Vec<f64> {
            let mut pi: Vec<f64> = (0..3).flat_map(|l| modelled(m, l)).collect();
            extra.into_iter().flatten().enumerate().for_each(|(k, x)| pi[INERTIAL + k] += x);
            torque_regressor(m, &q, &v, &a).iter().map(|row| row.iter().zip(&pi).map(|(y, p)| y * p).sum()).collect()
        };
        let (found, right) = (torque(&model, Some(point_mass(mass, place))), torque(&loaded, None));
        for j in 0..3 {
            assert!((found[j] - right[j]).abs() < 1e-9, "{found:?} {right:?}");
        }
    }
}
