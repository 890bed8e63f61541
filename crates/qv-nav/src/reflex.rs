//! The last word on a command: keeps head, middle and tail away from what the robot recalls to block, and slows down before the cone. It knows what
//! the robot recalls and nothing else; on a robot it runs between the network and the legs.

use crate::limits::{Limits, TAIL, give_way};
use crate::recall::{CELL, Recall};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// How the robot keeps away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reflex {
    /// Logarithm of the odds from which on a cell blocks.
    pub odds: f32,
    /// Room below which it keeps away \[m\].
    pub margin: f64,
    /// Speed away from what blocks where there is no room at all \[m/s\].
    pub push: f64,
    /// Distance of the head from the cone at which it stands \[m\].
    pub stand_off: f64,
    /// Greatest speed to the cone for each metre that is left \[1/s\].
    pub approach: f64,
    /// Speed at which it may always go on to the cone, since a distance that is said may be wrong \[m/s\].
    pub creep: f64,
}

impl Default for Reflex {
    fn default() -> Self {
        Self { odds: 1.1, margin: 0.16, push: 0.5, stand_off: 0.25, approach: 1.0, creep: 0.06 }
    }
}

impl Reflex {
    /// One that does nothing.
    pub fn none() -> Self {
        Self { margin: 0.0, approach: f64::INFINITY, ..Self::default() }
    }

    /// The command that is followed instead (forwards, to the left \[m/s\], turning \[rad/s\]); `head` is its distance before the base \[m\].
    pub fn apply(&self, recall: &Recall, head: f64, limits: &Limits, mut command: [f64; 3]) -> [f64; 3] {
        if let Some(cone) = recall.cone_now().filter(|c| c.x > 0.0 && c.y.abs() < 0.25 + 0.3 * c.x) {
            let left = cone.distance(DVec2::new(head, 0.0)) - self.stand_off;
            if self.approach.is_finite() {
                command[0] = command[0].min((self.approach * left).max(self.creep));
            }
        }
        for along in [head, 0.5 * head, 0.0, -TAIL] {
            let q = DVec2::new(along, 0.0);
            let Some((room, out)) = self.nearest(recall, q) else { continue };
            // As the teacher does.
            command = give_way(command, along, out, (self.margin - room) / self.margin * self.push);
        }
        limits.clamped(command)
    }

    /// Room at a point of the body and the direction away from the nearest cell that blocks, if it is nearer than the margin.
    fn nearest(&self, recall: &Recall, q: DVec2) -> Option<(f64, DVec2)> {
        let reach = ((self.margin + 0.5 * CELL) / CELL).ceil() as i32;
        let square =
            (-reach..=reach).flat_map(|i| (-reach..=reach).map(move |j| DVec2::new(f64::from(i), f64::from(j))));
        let blocks = square.map(|step| step * CELL).filter(|step| recall.odds(q + *step) > self.odds);
        let nearest = blocks.min_by(|a, b| a.length().total_cmp(&b.length()))?;
        let room = (nearest.length() - 0.5 * CELL).max(0.0);
        (room < self.margin).then(|| (room, (-nearest).normalize_or(DVec2::NEG_X)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::{RAYS, SIGHT};
    use crate::recall::{FARTHEST, Planar, ray};

    #[test]
    fn it_stops_before_what_blocks_and_before_the_cone() {
        let mut sight = [0.0; SIGHT];
        for k in 0..RAYS {
            sight[8 + k] = (0.20 / ray(k).cos()).ln() as f32;
            sight[8 + RAYS + k] = FARTHEST.ln() as f32;
        }
        let mut recall = Recall::new(DVec2::splat(3.0));
        let (limits, reflex) = (Limits::default(), Reflex::default());
        let apply = |recall: &Recall| reflex.apply(recall, 0.33, &limits, [0.5, 0.0, 0.2]);
        recall.go(Planar::default());
        assert_eq!(apply(&recall), [0.5, 0.0, 0.2], "nothing is known");
        for _ in 0..4 {
            recall.go(Planar::default());
            recall.see(&sight);
        }
        assert!(apply(&recall)[0] < 0.05, "{:?}", apply(&recall));
        assert_eq!(Reflex::none().apply(&recall, 0.33, &limits, [0.5, 0.0, 0.2]), [0.5, 0.0, 0.2]);
        // A cone 0.4 m before the head, in the open.
        let mut recall = Recall::new(DVec2::splat(3.0));
        let mut sight = [FARTHEST.ln() as f32; SIGHT];
        [0.0, 1.0, 0.73f32.ln(), 1.0].into_iter().enumerate().for_each(|(k, x)| sight[k] = x);
        recall.go(Planar::default());
        recall.see(&sight);
        assert!((apply(&recall)[0] - 0.15).abs() < 1e-5, "{:?}", apply(&recall));
    }
}
