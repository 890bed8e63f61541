//! Recordings that were made far from the origin.

use qv_recording::Run;
use qv_sim::Terrain;

/// A slope turns the ground about the origin: this far from it \[m\] the slope that any ground may have lifts it by decimetres, and soon
/// by more than all else that is looked at.
const FAR: f64 = 100.0;

/// Moves recordings that begin far from the origin to it, and their references along, where the ground is a plane, which looks the same
/// everywhere; gives what is to be said. `None` where nothing is far.
pub(crate) fn brought_near(
    runs: &mut [Run],
    reference: &mut [Run],
    terrain: &Terrain,
    given: &[(String, f64)],
) -> Option<String> {
    let pose = runs.first()?.measured.base_pose.as_ref()?;
    let [x, y] = [0, 1].map(|axis| pose.column(axis).find(|x| x.is_finite()).unwrap_or(0.0));
    if terrain.is_none() || x.hypot(y) < FAR {
        return None;
    }
    let is_sloped = given.iter().any(|(name, _)| name.starts_with("terrain.slope"));
    if is_sloped || !terrain.is_plane() {
        let remarks = format!(
            "the recording begins {:.0} m from the origin, about which slopes of the ground turn: move terrain and poses nearer, or slope and \
             height cannot be determined, nor what looks like them",
            x.hypot(y)
        );
        return Some(remarks);
    }
    runs.iter_mut().chain(reference).for_each(|run| shift(run, [x, y]));
    Some(format!(
        "places are given from where the recording begins, ({x:.3}, {y:.3}) m in its own coordinates, in calibrated.toml, too: move its \
         poses by that before you replay it with a part of the floor that was found"
    ))
}

fn shift(run: &mut Run, [x, y]: [f64; 2]) {
    let Some(pose) = &mut run.measured.base_pose else { return };
    for row in pose.values.chunks_exact_mut(pose.joints) {
        row[0] -= x;
        row[1] -= y;
    }
}
