//! The mirror image of a robot, left for right, found from the geometry of its stand.

use super::robot::TaskRobot;
use crate::symmetry::MirrorMap;
use glam::DVec3;
use qv_sim::JointKind;

/// How far a joint or foot may lie from the image of its partner, in heights of the robot: what rounded CAD dimensions differ by.
const PLACE: f64 = 0.02;
/// Largest difference of an axis from the image of its partner, as the length of a difference of unit vectors.
const AXIS: f64 = 0.03;
/// Largest relative difference of masses, gains, and of angles of the stand and the limits \[rad\].
const SHARE: f64 = 0.03;

/// Joints and feet of a robot in the mirror.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotMirror {
    /// Angles of the joints.
    pub joints: MirrorMap,
    /// Feet.
    pub feet: Vec<usize>,
}

/// Left and right exchanged.
fn mirrored(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.y, v.z)
}

impl TaskRobot {
    /// The robot's mirror image about its plane of x and z.
    ///
    /// # Errors
    /// What of it is not its own mirror image.
    pub fn mirror(&self) -> Result<RobotMirror, String> {
        let mut q = vec![0.0; self.model.nq()];
        q[3] = 1.0;
        self.stand.iter().enumerate().for_each(|(j, &angle)| q[7 + j] = f64::from(angle));
        let links = self.model.world_from_links(&q);
        let joints: Vec<[DVec3; 2]> =
            self.model.joints.iter().map(|j| [links[j.link].position, links[j.link].rotation * j.axis]).collect();
        let near = PLACE * f64::from(self.height);
        let mut map = MirrorMap::default();
        for (j, joint) in self.model.joints.iter().enumerate() {
            // A turn about an axis is, in the mirror, one about the image of the axis, the other way round.
            let [place, axis] = [mirrored(joints[j][0]), mirrored(joints[j][1])];
            let axis = if joint.kind == JointKind::Revolute { -axis } else { axis };
            let partner = (0..joints.len()).find_map(|k| {
                let near = joints[k][0].distance(place) < near;
                let sign = [1.0, -1.0].into_iter().find(|sign| (joints[k][1] * *sign).distance(axis) < AXIS);
                sign.filter(|_| near).map(|sign| (k, sign as f32))
            });
            let (k, sign) = partner.ok_or(format!("no joint is the mirror image of `{}` in the stand", joint.name))?;
            self.compare(j, k, sign)?;
            map.index.push(k);
            map.sign.push(sign);
        }
        let place = |foot: &usize| {
            let geom = &self.model.geoms[*foot];
            (links[geom.link] * geom.link_from_geom).position
        };
        let places: Vec<DVec3> = self.feet.iter().map(place).collect();
        let image = |p: &DVec3| places.iter().position(|other| other.distance(mirrored(*p)) < near);
        let feet: Option<Vec<usize>> = places.iter().map(image).collect();
        Ok(RobotMirror { joints: map, feet: feet.ok_or("a foot has no mirror image in the stand")? })
    }

    /// Whether joint `k` may stand for joint `j` in the mirror.
    fn compare(&self, j: usize, k: usize, sign: f32) -> Result<(), String> {
        let (a, b) = (&self.model.joints[j], &self.model.joints[k]);
        let masses = [a, b].map(|joint| self.model.links[joint.link].mass);
        // Beyond half a turn a limit limits nothing that matters here.
        let within = |x: f64| x.clamp(-std::f64::consts::PI, std::f64::consts::PI);
        let own = [a.lower, a.upper].map(within);
        let limits = if sign > 0.0 { [b.lower, b.upper] } else { [-b.upper, -b.lower] }.map(within);
        let apart = |x: f64, y: f64| (x - y).abs() > SHARE * x.abs().max(y.abs()).max(1e-9);
        let differences = [
            ("stand", (f64::from(self.stand[j]) - f64::from(sign * self.stand[k])).abs() > SHARE),
            ("lower limit", (own[0] - limits[0]).abs() > SHARE),
            ("upper limit", (own[1] - limits[1]).abs() > SHARE),
            ("kp", apart(f64::from(self.kp[j]), f64::from(self.kp[k]))),
            ("kd", apart(f64::from(self.kd[j]), f64::from(self.kd[k]))),
            ("action_scale", apart(f64::from(self.action_scale[j]), f64::from(self.action_scale[k]))),
            ("effort limit", a.effort.is_finite() && apart(a.effort, b.effort)),
            ("mass", apart(masses[0], masses[1])),
        ];
        match differences.iter().find(|(_, differs)| *differs) {
            Some((what, _)) => Err(format!("{what} of `{}` is not the mirror image of `{}`", a.name, b.name)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::velocity::RobotFile;

    #[test]
    fn left_legs_are_the_images_of_right_ones() {
        let file = RobotFile::parse(include_str!("../../robots/go1.toml")).unwrap();
        let mut robot = file.robot(include_str!("../../robots/go1.urdf")).unwrap();
        let mirror = robot.mirror().unwrap();
        assert_eq!(mirror.feet, [1, 0, 3, 2]);
        assert_eq!(mirror.joints.index, [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]);
        // Hips turn about x, which points forwards on both sides.
        let signs = [-1.0, 1.0, 1.0].repeat(4);
        assert_eq!(mirror.joints.sign, signs);
        robot.kp[0] *= 1.2;
        assert!(robot.mirror().unwrap_err().contains("kp"));
    }
}
