//! Descriptions of policies from other trainers, for `qv_policy::roll::Description::from_toml`.

/// Name and TOML text of each description.
pub const DESCRIPTIONS: [(&str, &str); 4] = [
    ("go2_rsl_rl", include_str!("../descriptions/go2_rsl_rl.toml")),
    ("rl_sar_go2", include_str!("../descriptions/rl_sar_go2.toml")),
    ("dls_go2", include_str!("../descriptions/dls_go2.toml")),
    ("playground_go1", include_str!("../descriptions/playground_go1.toml")),
];

#[cfg(test)]
mod tests {
    use super::*;
    use qv_policy::roll::Description;

    #[test]
    fn every_example_is_a_description_of_twelve_joints() {
        for (name, text) in DESCRIPTIONS {
            let description = Description::from_toml(text).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!((description.joints.len(), description.stand.len()), (12, 12), "{name}");
            assert!(!description.source.is_empty(), "{name}");
        }
    }
}
