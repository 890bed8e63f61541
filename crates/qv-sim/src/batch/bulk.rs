//! Many environments at once, in single precision: what learning reads and writes in every step. Nothing here allocates,
//! but for lists of contacts and states of lanes.

use super::lanes_of::Precision;
use super::quantities::{ContactPoint, GeomMotion, Quantity};
use super::{Batch, State};
use crate::commands::BatchCommand;
use crate::error::{finite, length};
use crate::parameters::WorldField;
use crate::sensors::{base_from_imu, imu_reading};
use crate::{BaseKind, SimError};

/// All that an environment's future depends on beside its parameters: positions and velocities, and the state of its
/// motors, kept commands, kept sensor readings, added torques and wrenches. Of batches of one model and the same options.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LaneState {
    values: Vec<f64>,
}

/// Numbers of a lane before its positions: whether its lags have settled, whether it knows no past, whether it is faulty, its time.
const LANE_HEAD: usize = 4;

impl<T: Precision> Batch<T> {
    fn read_all(&self, quantity: Quantity, what: &'static str, width: usize, out: &mut [f32]) -> Result<(), SimError> {
        length(what, self.len() * width, out.len())?;
        if width > 0 {
            self.engine.read_bulk(quantity, self.len(), out);
        }
        Ok(())
    }

    /// Positions of all environments, `[environments][nq]`.
    ///
    /// # Errors
    /// When the length is off; as all that follow.
    pub fn read_positions(&self, out: &mut [f32]) -> Result<(), SimError> {
        self.read_all(Quantity::Positions, "positions of all environments", self.model.nq(), out)
    }

    /// Velocities of all environments, `[environments][nv]`.
    ///
    /// # Errors
    /// When the length is off.
    pub fn read_velocities(&self, out: &mut [f32]) -> Result<(), SimError> {
        self.read_all(Quantity::Velocities, "velocities of all environments", self.model.nv(), out)
    }

    /// Accelerations of the last step, `[environments][nv]`.
    ///
    /// # Errors
    /// When the length is off.
    pub fn read_accelerations(&self, out: &mut [f32]) -> Result<(), SimError> {
        self.read_all(Quantity::Accelerations, "accelerations of all environments", self.model.nv(), out)
    }

    /// Torques that the motors delivered in the last step \[N m\], `[environments][joints]`, without added ones.
    ///
    /// # Errors
    /// When the length is off.
    pub fn read_torques(&self, out: &mut [f32]) -> Result<(), SimError> {
        self.read_all(Quantity::Torques, "torques of all environments", self.model.joints.len(), out)
    }

    /// Force of the ground on each shape in the last step \[N\], world axes, `[environments][geoms][3]`.
    ///
    /// # Errors
    /// When the length is off.
    pub fn read_geom_forces(&self, out: &mut [f32]) -> Result<(), SimError> {
        self.read_all(Quantity::GeomForces, "forces on all shapes", 3 * self.model.geoms.len(), out)
    }

    /// Positions and speeds as encoders report them, with each environment's encoder bias, `[environments][joints]`. Through a spring in series
    /// positions are those of the motors; speeds are those of the joints.
    ///
    /// # Errors
    /// When a length is off, or the batch keeps past readings (`max_sensor_latency`), which [`Batch::sensors`] reads.
    pub fn read_encoders(&self, q: &mut [f32], dq: &mut [f32]) -> Result<(), SimError> {
        self.no_sensor_latency()?;
        let joints = self.model.joints.len();
        self.read_all(Quantity::JointPositions, "encoder positions of all environments", joints, q)?;
        self.read_all(Quantity::JointSpeeds, "encoder speeds of all environments", joints, dq)
    }

    fn no_sensor_latency(&self) -> Result<(), SimError> {
        let found = self.shared.options.max_sensor_latency;
        if found == 0.0 {
            return Ok(());
        }
        let (what, expected) = ("max_sensor_latency of a bulk read".into(), "0 s".into());
        Err(SimError::Value { what, expected, found })
    }

    /// What the IMUs of all environments report: gyroscope \[rad/s\] and accelerometer \[m/s²\] in IMU axes
    /// (`[environments][3]`), and world from IMU (w, x, y, z; `[environments][4]`).
    ///
    /// # Errors
    /// When a length is off, or the base is fixed.
    pub fn read_imu(&self, gyro: &mut [f32], acc: &mut [f32], orientation: &mut [f32]) -> Result<(), SimError> {
        if self.model.base == BaseKind::Fixed {
            let (what, expected) = ("IMU of a robot".into(), "a floating base".into());
            return Err(SimError::Value { what, expected, found: 0.0 });
        }
        length("gyroscopes of all environments", 3 * self.len(), gyro.len())?;
        length("accelerometers of all environments", 3 * self.len(), acc.len())?;
        length("orientations of all environments", 4 * self.len(), orientation.len())?;
        let mounting = base_from_imu(&self.model, self.imu);
        for env in 0..self.len() {
            let motion = self.engine.base_motion(env);
            let world = |field: WorldField| self.world_value(env, field);
            let seen = imu_reading(&motion, mounting, self.shared.options.gravity, world);
            write(&seen.gyro, &mut gyro[3 * env..]);
            write(&seen.acc, &mut acc[3 * env..]);
            write(&seen.orientation, &mut orientation[4 * env..]);
        }
        Ok(())
    }

    fn world_value(&self, env: usize, field: WorldField) -> f64 {
        let id = self.catalogue.world_at + field as usize;
        // Most environments have few parameters of their own, and mostly none of the IMU.
        if self.overrides[env].is_empty() { self.catalogue.infos[id].neutral } else { self.value(env, id) }
    }

    /// Positions \[m\] and velocities \[m/s\] in the world of the centres of some shapes (indices into
    /// [`crate::Model::geoms`]), at the present state, `[environments][geoms][3]` each.
    ///
    /// # Errors
    /// When a length is off or there is no such shape.
    pub fn read_geoms(
        &mut self,
        geoms: &[usize],
        positions: &mut [f32],
        velocities: &mut [f32],
    ) -> Result<(), SimError> {
        let expected = 3 * geoms.len() * self.len();
        length("positions of shapes", expected, positions.len())?;
        length("velocities of shapes", expected, velocities.len())?;
        if let Some(&geom) = geoms.iter().find(|&&g| g >= self.model.geoms.len()) {
            let expected = format!("less than {}", self.model.geoms.len());
            return Err(SimError::Value { what: "index of a shape".into(), expected, found: geom as f64 });
        }
        self.engine.read_geoms(&self.shared, geoms, GeomMotion { positions, velocities });
        Ok(())
    }

    /// Contacts of the last step of one environment.
    ///
    /// # Errors
    /// When there is no such environment, or `keep_contacts` of the options is off.
    pub fn contacts(&self, env: usize) -> Result<Vec<ContactPoint>, SimError> {
        self.check_index(env)?;
        if !self.shared.options.keep_contacts {
            let (what, expected) = ("keep_contacts of the options".into(), "on".into());
            return Err(SimError::Value { what, expected, found: 0.0 });
        }
        Ok(self.engine.contacts(&self.shared, env))
    }

    /// Sets the commands that are held from the next step on, of all environments. Else as [`Batch::set_command`].
    ///
    /// # Errors
    /// When a length is off or a number is not finite; nothing is set then.
    pub fn set_commands(&mut self, command: &BatchCommand) -> Result<(), SimError> {
        let joints = self.model.joints.len();
        let all = joints * self.len();
        length("commanded positions of all environments", all, command.q.len())?;
        finite_f32("commanded position", command.q)?;
        let others = [
            ("commanded speeds of all environments", command.dq),
            ("position gains", Some(command.kp)),
            ("velocity gains", Some(command.kd)),
            ("feed-forward torques", command.tau),
        ];
        for (what, values) in others {
            let Some(values) = values else { continue };
            length(what, if values.len() == joints { joints } else { all }, values.len())?;
            finite_f32(what, values)?;
        }
        self.engine.write_commands(&self.shared, command);
        Ok(())
    }

    /// Torques added to what each motor delivers, behind its latency, lag and limits \[N m\], `[environments][joints]`.
    /// They are held until they are set again; [`Batch::set_state`] takes them away.
    ///
    /// # Errors
    /// When the length is off or a number is not finite.
    pub fn set_added_torques(&mut self, torques: &[f32]) -> Result<(), SimError> {
        length("added torques of all environments", self.len() * self.model.joints.len(), torques.len())?;
        finite_f32("added torque", torques)?;
        self.engine.write_added_torques(torques);
        Ok(())
    }

    /// A force \[N\] and a torque \[N m\] on a link at its centre of mass, world axes, held until they are set again;
    /// [`Batch::set_state`] takes them away.
    ///
    /// # Errors
    /// When there is no such environment or link, or a number is not finite.
    pub fn set_wrench(&mut self, env: usize, link: usize, force: [f64; 3], torque: [f64; 3]) -> Result<(), SimError> {
        self.check_index(env)?;
        if link >= self.model.links.len() {
            let expected = format!("less than {}", self.model.links.len());
            return Err(SimError::Value { what: "index of a link".into(), expected, found: link as f64 });
        }
        finite("force on a link", &force)?;
        finite("torque on a link", &torque)?;
        let [tx, ty, tz] = torque;
        let [fx, fy, fz] = force;
        self.engine.write_wrench(env, link, [tx, ty, tz, fx, fy, fz]);
        Ok(())
    }

    /// Changes the velocities by so much (a push), and nothing else. Shape `[nv]`, as [`State::v`].
    ///
    /// # Errors
    /// When there is no such environment, the length is off, or a number is not finite.
    pub fn add_velocity(&mut self, env: usize, change: &[f64]) -> Result<(), SimError> {
        self.check_index(env)?;
        length("velocities", self.model.nv(), change.len())?;
        finite("velocity", change)?;
        self.engine.add_velocity(env, change);
        Ok(())
    }

    /// Sets positions and velocities and keeps all else: time, parameters, the state of the motors, kept commands and readings. So a
    /// simulation that ran beside a recording begins anew from what was measured, its motors warm.
    ///
    /// # Errors
    /// As [`Batch::set_state`].
    pub fn move_to(&mut self, env: usize, state: &State) -> Result<(), SimError> {
        let mut lane = std::mem::take(&mut self.passing);
        let read = self.check_index(env).map(|()| self.engine.read_lane(&self.shared, env, &mut lane));
        // Setting the state checks and normalises it; the rest of the lane is put back.
        let done = read.and_then(|()| self.set_state(env, state)).and_then(|()| self.state(env));
        if let Ok(now) = &done {
            let moving = now.q.iter().chain(&now.v);
            lane[LANE_HEAD..].iter_mut().zip(moving).for_each(|(kept, x)| *kept = *x);
            self.engine.write_lane(&self.shared, env, &lane);
        }
        self.passing = lane;
        done.map(|_| ())
    }

    /// [`Batch::set_state`] for all environments of which `mask` is true; `state(env)` shows the state of each.
    ///
    /// # Errors
    /// When the mask's length is off, and as [`Batch::set_state`]; environments before the bad one are set then.
    pub fn reset(&mut self, mask: &[bool], mut state: impl FnMut(usize) -> State) -> Result<(), SimError> {
        length("mask of environments", self.len(), mask.len())?;
        for env in (0..mask.len()).filter(|&env| mask[env]) {
            self.set_state(env, &state(env))?;
        }
        Ok(())
    }

    /// The state of an environment with that of its motors and all that is kept of its past.
    ///
    /// # Errors
    /// When there is no such environment.
    pub fn read_lane(&self, env: usize, lane: &mut LaneState) -> Result<(), SimError> {
        self.check_index(env)?;
        self.engine.read_lane(&self.shared, env, &mut lane.values);
        Ok(())
    }

    /// Sets what [`Batch::read_lane`] read, in this or another batch of the same model and options. Parameters stay.
    ///
    /// # Errors
    /// When there is no such environment, or the state is of another model or other options.
    pub fn write_lane(&mut self, env: usize, lane: &LaneState) -> Result<(), SimError> {
        self.check_index(env)?;
        let mut own = std::mem::take(&mut self.passing);
        self.engine.read_lane(&self.shared, env, &mut own);
        let expected = own.len();
        self.passing = own;
        length("state of a lane", expected, lane.values.len())?;
        self.engine.write_lane(&self.shared, env, &lane.values);
        Ok(())
    }

    /// Gives an environment the whole state of another, see [`LaneState`]. Parameters stay.
    ///
    /// # Errors
    /// When there is no such environment.
    pub fn copy_lane(&mut self, from: usize, to: usize) -> Result<(), SimError> {
        self.check_index(from)?;
        self.check_index(to)?;
        let mut passing = std::mem::take(&mut self.passing);
        self.engine.read_lane(&self.shared, from, &mut passing);
        self.engine.write_lane(&self.shared, to, &passing);
        self.passing = passing;
        Ok(())
    }
}

fn write(values: &[f64], out: &mut [f32]) {
    values.iter().zip(out).for_each(|(&value, target)| *target = value as f32);
}

fn finite_f32(what: &str, values: &[f32]) -> Result<(), SimError> {
    // Any number times zero is zero, but for NaN and infinities; a sum is checked faster than each.
    if values.iter().fold(0.0, |sum, v| sum + v * 0.0) == 0.0 {
        return Ok(());
    }
    let Some(at) = values.iter().position(|v| !v.is_finite()) else { return Ok(()) };
    let (what, expected) = (format!("{what} {at}"), "a finite number".into());
    Err(SimError::Value { what, expected, found: f64::from(values[at]) })
}
