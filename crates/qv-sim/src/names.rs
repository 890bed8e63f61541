//! Names that are nearly right.

/// Fewest letters to add, drop or change from `a` to `b` (Levenshtein 1966).
pub(crate) fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for j in 0..b.len() {
            let substituted = diagonal + usize::from(x != b[j]);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// The name of `known` that `name` was most probably meant to be; a part of a name that fits, such as `friction` of `ground_friction`,
/// is nearer than a whole one that is alike by chance. `None` when nothing is known.
pub fn nearest<'k>(name: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    let distance = |whole: &str| {
        let parts = whole.split(['_', '.']).map(|part| 1 + edit_distance(part, name));
        let all = edit_distance(whole, name);
        (parts.fold(all, usize::min), all)
    };
    known.into_iter().min_by_key(|known| distance(known))
}

/// What is wrong with a name, such as `unknown effect "frictoin"; nearest: ground_friction`.
pub fn unknown<'k>(kind: &str, name: &str, known: impl IntoIterator<Item = &'k str>) -> String {
    let nearest = nearest(name, known).map_or("none, as nothing has a name here".into(), str::to_owned);
    format!("unknown {kind} \"{name}\"; nearest: {nearest}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_names_find_theirs() {
        let effects = ["backlash", "joint_coulomb_friction", "ground_friction", "payload_mass", "com_offset"];
        for (name, meant) in [
            ("frictoin", "ground_friction"),
            ("ground_frictoin", "ground_friction"),
            ("coulomb", "joint_coulomb_friction"),
            ("payload", "payload_mass"),
            ("Backlash", "backlash"),
        ] {
            assert_eq!(nearest(name, effects), Some(meant), "{name}");
        }
        let parameters = ["joint.FL_calf_joint.armature", "joint.FR_calf_joint.armature", "actuator.FL_calf_joint.lag"];
        assert_eq!(nearest("joint.FR_calf.armature", parameters), Some(parameters[1]));
        assert_eq!(unknown("effect", "x", []), "unknown effect \"x\"; nearest: none, as nothing has a name here");
        assert_eq!(unknown("effect", "backlsh", effects), "unknown effect \"backlsh\"; nearest: backlash");
    }
}
