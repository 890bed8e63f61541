//! The library spelt out for one robot: what can be moved, in which groups, and at which values the simulator is asked.

use crate::GapError;
use crate::problem::library::{Effect, LevelsOf, OF_BASE, OF_GROUND, Scope};
use crate::problem::sizes::Sizes;
use crate::problem::torques::{largest_speeds, largest_torques};
use qv_recording::Run;
use qv_recording::run::GainSource;
use qv_rollout::{Overrides, Rollout};
use serde::{Deserialize, Serialize};

/// Share of a range that is searched beyond either end of it.
const MARGIN: f64 = 0.08;

/// One axis of one member of an effect: the smallest thing that can be moved.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    /// Index in the library.
    pub effect: usize,
    /// Index of the axis.
    pub axis: usize,
    /// Index of the member, such as a joint.
    pub member: usize,
    /// Parameters that it moves and by which factor.
    pub moves: Vec<(usize, f64)>,
    /// Value when the effect is absent; not finite for a limit that is not there.
    pub absent: f64,
}

/// A unit at a value: a column of the sensitivities is the change that this makes.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Index of the unit.
    pub unit: usize,
    /// Which of its levels.
    pub level: usize,
    /// The value.
    pub value: f64,
    /// Spread of the tolerated deviations, as a share of the step from absent to `value`; 0 = none tolerated.
    pub tolerance: f64,
}

/// Members that an effect moves together.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Index in the library.
    pub effect: usize,
    /// Names in reports: `all`, or of joints, legs, feet.
    pub names: Vec<String>,
    /// Indices of the members.
    pub members: Vec<usize>,
}

/// The library for one robot.
pub struct Columns {
    /// Effects that this robot can have.
    pub effects: Vec<Effect>,
    /// All units.
    pub units: Vec<Unit>,
    /// All columns; those with a tolerance first.
    pub columns: Vec<Column>,
    /// Number of columns with a tolerance.
    pub tolerated: usize,
    /// All groups.
    pub groups: Vec<Group>,
}

/// A part of the recording that an effect is confined to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Extent {
    /// From and until \[s\].
    Time([f64; 2]),
    /// x from and to, y from and to \[m\].
    Region([f64; 4]),
}

impl Extent {
    /// Its numbers.
    pub fn numbers(&self) -> Vec<f64> {
        match self {
            Self::Time(t) => t.to_vec(),
            Self::Region(r) => r.to_vec(),
        }
    }

    /// The same kind with other numbers.
    pub fn with(&self, numbers: &[f64]) -> Self {
        match self {
            Self::Time(_) => Self::Time([numbers[0], numbers[1]]),
            Self::Region(_) => Self::Region([numbers[0], numbers[1], numbers[2], numbers[3]]),
        }
    }

    /// Whether it has an inside.
    pub fn is_open(&self) -> bool {
        match self {
            Self::Time(t) => t[1] - t[0] > 0.02,
            Self::Region(r) => r[1] - r[0] > 0.05 && r[3] - r[2] > 0.05,
        }
    }
}

/// What the library is spelt out by.
struct OfRobot<'p, 'a> {
    rollout: &'p Rollout<'a>,
    sizes: Sizes,
    /// Largest torque of each joint \[N m\],
    torques: Vec<f64>,
    /// and largest speed \[rad/s\].
    speeds: Vec<f64>,
    /// How its gains are known.
    gains: [GainSource; 2],
}

impl OfRobot<'_, '_> {
    /// Standard deviation, as a share, of the gain that an effect scales, where that gain was found and not stated.
    fn deviation_of_found(&self, effect: &Effect) -> Option<f64> {
        let scales = |end: &str| effect.axes.iter().flat_map(|a| a.moves.keys()).any(|name| name.ends_with(end));
        self.gains.iter().zip([".kp_scale", ".kd_scale"]).find_map(|(known, end)| match known {
            GainSource::Found(deviation) if scales(end) => Some(*deviation),
            _ => None,
        })
    }

    /// What levels are shares of: 1 when they are none.
    fn largest(&self, of: Option<LevelsOf>, joint: usize) -> f64 {
        let all = match of {
            None => return 1.0,
            Some(LevelsOf::Torque) => &self.torques,
            Some(LevelsOf::Speed) => &self.speeds,
            Some(LevelsOf::Weight) => return weight(self.rollout),
        };
        all.get(joint).copied().unwrap_or(0.0)
    }
}

/// What a robot weighs \[N\].
fn weight(rollout: &Rollout) -> f64 {
    qv_core::GRAVITY * rollout.model.links.iter().map(|link| link.mass).sum::<f64>()
}

/// A value for every axis of a group.
#[derive(Debug, Clone, PartialEq)]
pub struct Suspect {
    /// Index of the group.
    pub group: usize,
    /// Value of each axis.
    pub values: Vec<f64>,
    /// What it is confined to.
    pub extent: Option<Extent>,
}

impl Suspect {
    /// An effect that acts everywhere and always.
    pub fn everywhere(group: usize, values: Vec<f64>) -> Self {
        Self { group, values, extent: None }
    }
}

impl Columns {
    /// Spells out `library` for a robot. Effects whose parameters this robot lacks are left out.
    ///
    /// # Errors
    /// When an effect names a parameter that the simulator does not have for any robot of this kind.
    pub fn new(rollout: &Rollout, run: &Run, library: &[Effect]) -> Result<Self, GapError> {
        let mut all =
            Self { effects: Vec::new(), units: Vec::new(), columns: Vec::new(), tolerated: 0, groups: Vec::new() };
        let of_robot = OfRobot {
            rollout,
            sizes: Sizes::new(rollout, run),
            torques: largest_torques(rollout, run),
            speeds: largest_speeds(rollout, run),
            gains: run.actuator.gains,
        };
        for effect in library {
            let members = members(rollout, effect);
            if members.is_empty() || !is_observable(rollout, effect) {
                continue;
            }
            all.add(&of_robot, effect, &members)?;
        }
        all.columns.sort_by_key(|c| c.tolerance == 0.0);
        all.tolerated = all.columns.iter().filter(|c| c.tolerance > 0.0).count();
        Ok(all)
    }

    fn add(&mut self, of_robot: &OfRobot, effect: &Effect, members: &[String]) -> Result<(), GapError> {
        let (rollout, index) = (of_robot.rollout, self.effects.len());
        let mut sized = of_robot.sizes.of(rollout, effect, moved(rollout, effect, members));
        if let Some(deviation) = of_robot.deviation_of_found(&sized) {
            sized.nuisance = true;
            sized.tolerance = sized.tolerance.max(deviation);
        }
        let effect = &sized;
        for (member, name) in members.iter().enumerate() {
            for (axis, a) in effect.axes.iter().enumerate() {
                let mut moves = Vec::new();
                for (pattern, factor) in &a.moves {
                    let parameter = spell(pattern, name);
                    let unknown = || GapError::Library {
                        file: effect.file.clone(),
                        expected: format!("a parameter of the simulator in effect `{}`", effect.name),
                        found: qv_sim::names::unknown(
                            "parameter",
                            &parameter,
                            rollout.catalogue.iter().map(|p| p.name.as_str()),
                        ),
                    };
                    let id = rollout.parameter(&parameter).ok_or_else(unknown)?;
                    moves.push((id, *factor));
                }
                let absent = if effect.absolute { rollout.nominal[moves[0].0] / moves[0].1 } else { 0.0 };
                let absent = if effect.levels_of.is_some() { f64::INFINITY } else { absent };
                let scale = of_robot.largest(effect.levels_of, member);
                let unit = self.units.len();
                self.units.push(Unit { effect: index, axis, member, moves, absent });
                for (level, share) in effect.levels.iter().enumerate().filter(|_| scale > 0.0) {
                    let value = share * scale;
                    let step = if absent.is_finite() { (value - absent).abs() } else { 1.0 };
                    let tolerance = if level == 0 { effect.tolerance / step } else { 0.0 };
                    if step > 0.0 {
                        self.columns.push(Column { unit, level, value, tolerance });
                    }
                }
            }
        }
        self.groups.extend(groups(rollout, index, effect.scope, members));
        self.effects.push(Effect { range: self.meaningful(rollout, index, effect), ..effect.clone() });
        Ok(())
    }

    /// The effect's range with a margin, since a true value may lie at its very end, and without what means nothing for
    /// this robot, such as taking away more than a link weighs.
    fn meaningful(&self, rollout: &Rollout, index: usize, effect: &Effect) -> [f64; 2] {
        let mut range = effect.range;
        let absent = self.units.iter().find(|u| u.effect == index).map_or(0.0, |u| u.absent);
        let margin = MARGIN * effect.span();
        if range[0] != absent && !effect.absolute {
            range[0] -= margin;
        }
        if range[1] != absent {
            range[1] += margin;
        }
        let is_wide = !rollout.free && effect.held_range.is_some();
        // Of values in different units each parameter is held within its own bounds alone.
        let is_alike = effect.axes.iter().all(|axis| axis.unit.is_none());
        for unit in self.units.iter().filter(|u| u.effect == index && !effect.absolute && is_alike) {
            for &(id, factor) in &unit.moves {
                let (info, nominal) = (&rollout.catalogue[id], rollout.nominal[id]);
                if factor > 0.0 && info.range.0 < nominal {
                    // As far beyond that end as beyond the others. What a robot that is held may be off by only its physics bounds.
                    let beyond = nominal + (1.0 + 2.0 * MARGIN) * (info.range.0 - nominal);
                    let least = info.clamped(f64::NEG_INFINITY);
                    let end = if is_wide && least.is_finite() { least } else { info.clamped(beyond) };
                    range[0] = range[0].max((end - nominal) / factor);
                }
            }
        }
        range
    }

    /// Looks whether every level, and the ends of absolute ranges, give parameters of this robot values that mean something.
    ///
    /// # Errors
    /// Names the first that does not, and its file.
    pub fn check(&self, rollout: &Rollout) -> Result<(), GapError> {
        for unit in &self.units {
            let effect = &self.effects[unit.effect];
            let levels = self.columns.iter().filter(|c| self.units[c.unit] == *unit).map(|c| c.value);
            let ends = effect.range.into_iter().filter(|_| effect.absolute);
            for (value, &(id, factor)) in levels.chain(ends).flat_map(|v| unit.moves.iter().map(move |m| (v, m))) {
                let info = &rollout.catalogue[id];
                let moved = if effect.absolute { factor * value } else { rollout.nominal[id] + factor * value };
                if info.clamped(moved) != moved {
                    return Err(GapError::Library {
                        file: effect.file.clone(),
                        expected: format!(
                            "values of effect `{}` that leave `{}` at least {}",
                            effect.name,
                            info.name,
                            info.clamped(moved)
                        ),
                        found: format!("{value}, which makes it {moved}"),
                    });
                }
            }
        }
        Ok(())
    }

    /// Units of a group along an axis.
    pub(crate) fn units_of(&self, group: &Group, axis: usize) -> impl Iterator<Item = usize> + '_ {
        let (effect, members) = (group.effect, group.members.clone());
        (0..self.units.len()).filter(move |&u| {
            let unit = &self.units[u];
            unit.effect == effect && unit.axis == axis && members.contains(&unit.member)
        })
    }

    /// The column of a unit at a level.
    pub fn column(&self, unit: usize, level: usize) -> Option<usize> {
        self.columns.iter().position(|c| c.unit == unit && c.level == level)
    }

    /// The setting in which units have values.
    pub fn setting(&self, rollout: &Rollout, values: &[(usize, f64)]) -> Overrides {
        let mut setting: std::collections::BTreeMap<usize, f64> = std::collections::BTreeMap::new();
        for &(unit, value) in values {
            let absolute = self.effects[self.units[unit].effect].absolute;
            for &(id, factor) in &self.units[unit].moves {
                let before = setting.get(&id).copied().unwrap_or(rollout.nominal[id]);
                let after = if absolute { factor * value } else { before + factor * value };
                setting.insert(id, rollout.catalogue[id].clamped(after));
            }
        }
        setting.into_iter().collect()
    }

    /// The setting in which suspects have their values.
    pub(crate) fn setting_of(&self, rollout: &Rollout, suspects: &[Suspect]) -> Overrides {
        self.setting_beside(rollout, &[], suspects)
    }

    /// The same for a robot some of whose units deviate already.
    pub(crate) fn setting_beside(
        &self,
        rollout: &Rollout,
        deviant: &[(usize, f64)],
        suspects: &[Suspect],
    ) -> Overrides {
        let mut units = deviant.to_vec();
        let mut fixed: Vec<(String, f64)> = Vec::new();
        for suspect in suspects {
            let group = &self.groups[suspect.group];
            if let Some(Extent::Region([x0, x1, y0, y1])) = suspect.extent {
                // Nowhere: a patch that is given stays.
                if [x0, x1, y0, y1] == [0.0; 4] {
                    continue;
                }
                let of_patch =
                    [("x_min", x0), ("x_max", x1), ("y_min", y0), ("y_max", y1), ("friction", suspect.values[0])];
                fixed.extend(of_patch.map(|(name, value)| (format!("terrain.patch.{name}"), value)));
                continue;
            }
            if let Some(Extent::Time([from, until])) = suspect.extent {
                fixed.push(("external.start".into(), from));
                fixed.push(("external.duration".into(), (until - from).max(0.0)));
            }
            for (axis, &value) in suspect.values.iter().enumerate() {
                units.extend(self.units_of(group, axis).map(|u| (u, value)));
            }
        }
        let mut setting = self.setting(rollout, &units);
        for (name, value) in fixed {
            if let Some(id) = rollout.parameter(&name) {
                setting.retain(|s| s.0 != id);
                setting.push((id, rollout.catalogue[id].clamped(value)));
            }
        }
        setting.sort_by_key(|s| s.0);
        setting
    }
}

/// Names of what an effect acts on.
fn members(rollout: &Rollout, effect: &Effect) -> Vec<String> {
    let model = rollout.model;
    match effect.scope {
        Scope::Joints => model.joint_names().to_vec(),
        Scope::Links => model.links.iter().filter(|l| l.mass > 0.0).map(|l| l.name.clone()).collect(),
        Scope::Base if rollout.free => vec![model.links[0].name.clone()],
        Scope::Base => model.links.iter().map(|l| l.name.clone()).collect(),
        Scope::Feet => rollout.feet.geoms.iter().map(|&g| model.geoms[g].name.clone()).collect(),
        Scope::Ground if rollout.terrain.is_none() => Vec::new(),
        Scope::Ground if rollout.terrain.materials().is_empty() => vec!["contact".into()],
        Scope::Ground => rollout.terrain.materials().iter().map(|(name, _)| format!("material.{name}")).collect(),
        Scope::World => vec!["all".into()],
    }
}

/// Whether anything measured could show an effect: one that only moves the base, contacts or sensors of a free robot has
/// no meaning for a robot that is held.
fn is_observable(rollout: &Rollout, effect: &Effect) -> bool {
    if rollout.free && effect.held_only {
        return false;
    }
    let moves = |prefix: &str| effect.axes.iter().flat_map(|a| a.moves.keys()).any(|p| p.starts_with(prefix));
    if !rollout.free && OF_BASE.iter().any(|p| moves(p)) {
        return false;
    }
    // Without poses nobody says how late they are, and how high the ground lies.
    if rollout.on_legs && ["sensor.pose", "terrain.height"].iter().any(|p| moves(p)) {
        return false;
    }
    if rollout.terrain.is_none() && OF_GROUND.iter().any(|p| moves(p)) {
        return false;
    }
    // The scale of the torque sensor shows in the torque alone.
    !effect.axes.iter().flat_map(|a| a.moves.keys()).all(|p| p.ends_with(".torque_scale"))
        || !rollout.law_joints.is_empty()
}

/// Parameters that an effect moves in its members.
fn moved<'s>(rollout: &'s Rollout, effect: &'s Effect, members: &'s [String]) -> impl Iterator<Item = usize> + 's {
    let of_member = move |name: &'s String| {
        let patterns = effect.axes.iter().flat_map(|a| a.moves.keys());
        patterns.filter_map(move |pattern| rollout.parameter(&spell(pattern, name)))
    };
    members.iter().flat_map(of_member)
}

fn spell(pattern: &str, member: &str) -> String {
    ["{joint}", "{link}", "{base}", "{foot}", "{ground}"]
        .iter()
        .fold(pattern.to_string(), |p, slot| p.replace(slot, member))
}

fn groups(rollout: &Rollout, effect: usize, scope: Scope, members: &[String]) -> Vec<Group> {
    let group = |names: Vec<String>, members: Vec<usize>| Group { effect, names, members };
    let all = group(vec!["all".into()], (0..members.len()).collect());
    if members.len() == 1 {
        return vec![all];
    }
    let singles = members.iter().enumerate().map(|(m, name)| group(vec![name.clone()], vec![m]));
    match scope {
        Scope::Base => singles.collect(),
        Scope::Joints | Scope::Links => {
            let mut sets: Vec<Group> = vec![all];
            for kind in kinds(rollout, members) {
                sets.push(group(kind.iter().map(|&m| members[m].clone()).collect(), kind));
            }
            for foot in &rollout.feet.names {
                let of_leg: Vec<usize> =
                    (0..members.len()).filter(|&m| leg_of(rollout, &members[m]) == Some(foot)).collect();
                if of_leg.len() > 1 {
                    sets.push(group(vec![foot.clone()], of_leg));
                }
            }
            sets.extend(singles);
            sets
        }
        _ => std::iter::once(all).chain(singles).collect(),
    }
}

/// Leg whose name the member's begins with.
fn leg_of<'a>(rollout: &'a Rollout, member: &str) -> Option<&'a String> {
    rollout.feet.names.iter().find(|foot| member.strip_prefix(foot.as_str()).is_some_and(|rest| rest.starts_with('_')))
}

/// Members of the same name on different legs.
fn kinds(rollout: &Rollout, members: &[String]) -> Vec<Vec<usize>> {
    let mut kinds: Vec<(&str, Vec<usize>)> = Vec::new();
    for (m, name) in members.iter().enumerate() {
        let Some(kind) = leg_of(rollout, name).and_then(|leg| name.strip_prefix(leg.as_str())) else { continue };
        match kinds.iter_mut().find(|(k, _)| *k == kind) {
            Some((_, of_kind)) => of_kind.push(m),
            None => kinds.push((kind, vec![m])),
        }
    }
    kinds.into_iter().map(|(_, of_kind)| of_kind).filter(|k| k.len() > 1 && k.len() < members.len()).collect()
}
