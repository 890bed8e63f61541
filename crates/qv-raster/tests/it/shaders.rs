//! Every variant of every shader passes naga's validation; no graphics card is needed.

use naga::valid::{Capabilities, ValidationFlags, Validator};
use qv_raster::shaders::{STAGES, Variant, text};

fn variants() -> Vec<Variant> {
    let mut out = vec![];
    for subgroup in [0, 8, 16, 32] {
        for (sh_count, features) in [(1, 0), (4, 1), (9, 0), (16, 16)] {
            for flags in 0..32u32 {
                let on = |bit: u32| flags >> bit & 1 == 1;
                out.push(Variant {
                    subgroup,
                    sh_count,
                    features,
                    depth: on(0),
                    plane: on(1),
                    bytes: on(2),
                    keep: on(3),
                    atomic: on(3) && subgroup > 0 && on(2),
                    antialias: on(4),
                    digit: if subgroup == 0 { 8 } else { 5 + flags % 2 },
                });
            }
        }
    }
    out
}

#[test]
fn every_variant_of_every_shader_is_valid() {
    let mut seen = std::collections::HashSet::new();
    for variant in variants() {
        for (stage, entries) in STAGES {
            let text = text(stage, &variant);
            if !seen.insert(text.clone()) {
                continue;
            }
            let module = naga::front::wgsl::parse_str(&text)
                .unwrap_or_else(|error| panic!("{stage} {variant:?}: {}", error.emit_to_string(&text)));
            let capabilities =
                Capabilities::SUBGROUP | Capabilities::SHADER_FLOAT32_ATOMIC | Capabilities::SHADER_FLOAT16_IN_FLOAT32;
            if let Err(error) = Validator::new(ValidationFlags::all(), capabilities).validate(&module) {
                panic!("{stage} {variant:?}: {}", error.emit_to_string(&text));
            }
            let mut found: Vec<&str> = module.entry_points.iter().map(|entry| entry.name.as_str()).collect();
            found.sort_unstable();
            let mut expected = entries.to_vec();
            expected.sort_unstable();
            assert_eq!(found, expected, "{stage}");
        }
    }
    assert!(seen.len() > 60, "{} texts", seen.len());
}
