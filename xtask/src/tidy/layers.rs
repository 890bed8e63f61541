//! Which crate may use which, and what each crate must have.

use super::source::Source;
use crate::workspace::{Package, Workspace, short};
use std::path::Path;

/// Layer of each crate; the table of docs/dev/ARCHITECTURE.md. `qv` and `xtask` are above all and used by none.
const LAYERS: &[(&str, u8)] = &[
    ("qv-core", 0),
    ("qv-page", 0),
    ("qv-fleet", 1),
    ("qv-fit", 1),
    ("qv-sim", 1),
    ("qv-raster", 1),
    ("qv-mesh", 1),
    ("qv-splat", 2),
    ("qv-recording", 2),
    ("qv-policy", 2),
    ("qv-rollout", 3),
    ("qv-go2", 3),
    ("qv-nav", 3),
    ("yard", 3),
    ("qv-replay", 4),
    ("qv-contact", 4),
    ("qv-residual", 4),
    ("qv-held", 4),
    ("qv-live", 4),
    ("qv-gap", 5),
    ("qv-camera", 6),
    ("qv-open", 6),
    ("qv-sealed", 6),
    ("qv", 7),
    ("qv-py", 7),
    ("xtask", 7),
];

/// Layer of a crate of the workspace, by its short name.
pub fn layer(name: &str) -> Option<u8> {
    LAYERS.iter().find(|(known, _)| *known == name).map(|(_, layer)| *layer)
}

/// All findings about packages.
pub fn check(workspace: &Workspace, sources: &[Source]) -> Vec<String> {
    let mut found = Vec::new();
    for package in workspace.members() {
        found.extend(directions(package));
        found.extend(gpu_gate(package));
        found.extend(completeness(package, &workspace.workspace_root, sources));
        found.extend(for_a_registry(package));
    }
    found
}

/// Dependencies must point to a lower layer. Those of tests and examples are free: the Go2 may walk in the tests of
/// the simulator, which ships without it.
fn directions(package: &Package) -> Vec<String> {
    let Some(own) = layer(&package.short()) else {
        return vec![format!("{}: expected a crate of the layer table, found none of that name", package.name)];
    };
    let shipped = package.dependencies.iter().filter(|dependency| dependency.kind.as_deref() != Some("dev"));
    shipped
        .filter_map(|dependency| Some((dependency, layer(&short(&dependency.name))?)))
        .filter(|(_, theirs)| *theirs >= own)
        .map(|(dependency, theirs)| {
            format!(
                "{} (layer {own}): expected dependencies below, found {} (layer {theirs})",
                package.name, dependency.name
            )
        })
        .collect()
}

/// wgpu must be optional and turned on by the feature `gpu` only.
fn gpu_gate(package: &Package) -> Vec<String> {
    let mut found = Vec::new();
    let gpu_crates = package.dependencies.iter().filter(|d| d.name.starts_with("wgpu") && d.kind.is_none());
    for dependency in gpu_crates {
        if !dependency.optional {
            found.push(format!(
                "{}: expected {} behind the feature gpu, found it always on",
                package.name, dependency.name
            ));
        }
        let (explicit, implicit) = (format!("dep:{}", dependency.name), dependency.name.clone());
        for (feature, parts) in &package.features {
            let turns_on = parts.iter().any(|part| *part == explicit || *part == implicit);
            if turns_on && feature != "gpu" {
                found
                    .push(format!("{}: expected {} in the feature gpu, found it in {feature}", package.name, implicit));
            }
        }
    }
    found
}

/// Every library has a page of its own that says its layer and names an example, every crate a line on the page of the architecture and the licence of the workspace.
fn completeness(package: &Package, root: &Path, sources: &[Source]) -> Vec<String> {
    let mut found = Vec::new();
    if package.has_target("lib") && !package.has_target("example") {
        found.push(format!("{}: expected a runnable example, found none", package.name));
    }
    // The native part of the Python package is a library for Python alone.
    let name = package.short();
    if package.has_target("lib") && name.starts_with("qv-") && name != "qv-py" {
        found.extend(own_page(package, root, sources));
    }
    if package.license.as_deref() != Some("MIT OR Apache-2.0") {
        found.push(format!("{}: expected the licence MIT OR Apache-2.0, found {:?}", package.name, package.license));
    }
    let mentioned = format!("`{name}`");
    let page = "docs/dev/ARCHITECTURE.md";
    let text = sources.iter().find(|source| source.path == Path::new(page)).map(|source| source.text.as_str());
    if !text.is_some_and(|text| text.contains(&mentioned)) {
        found.push(format!("{page}: expected it to name the crate {mentioned}, found nothing"));
    }
    if name.starts_with("qv") && package.folder() != root.join("crates").join(&name) {
        found.push(format!("{}: expected it in crates/{name}", package.name));
    }
    found
}

/// What is published has a name that no stranger has, beside the short name in code, and says what it is.
fn for_a_registry(package: &Package) -> Vec<String> {
    if !package.is_published() {
        return Vec::new();
    }
    let mut found = Vec::new();
    let name = package.short();
    if name == package.name {
        found.push(format!("{name}: expected a published package to be named quadverse-*, found {name}"));
    }
    let in_code = name.replace('-', "_");
    if !package.targets.iter().any(|target| target.name == in_code) {
        found.push(format!("{}: expected it to build {in_code}, found nothing of that name", package.name));
    }
    let said = [
        ("description", package.description.is_some()),
        ("keywords", !package.keywords.is_empty()),
        ("categories", !package.categories.is_empty()),
    ];
    for (what, _) in said.iter().filter(|(_, is_there)| !is_there) {
        found.push(format!("{}: expected {what} in Cargo.toml, found none", package.name));
    }
    found
}

/// README.md of a library.
fn own_page(package: &Package, root: &Path, sources: &[Source]) -> Option<String> {
    let path = package.folder().strip_prefix(root).unwrap_or(package.folder()).join("README.md");
    let Some(page) = sources.iter().find(|source| source.path == path) else {
        return Some(format!("{}: expected a page that says what the crate is, found none", path.display()));
    };
    let says = format!("| layer | {} of 7", layer(&package.short())?);
    if !page.text.contains(&says) {
        return Some(format!("{}: expected `{says}`, found another layer or none", path.display()));
    }
    let example =
        page.text.split("--example ").nth(1).and_then(|rest| rest.split_whitespace().next()).unwrap_or("none");
    let found = || format!("{}: expected an example of the crate, found {example}", path.display());
    (!package.has_example(example)).then(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::{Dependency, Target};

    fn package(name: &str, dependencies: &[(&str, Option<&str>)]) -> Package {
        Package {
            name: name.into(),
            version: "0.2.0".into(),
            id: name.into(),
            license: Some("MIT OR Apache-2.0".into()),
            manifest_path: format!("/top/crates/{name}/Cargo.toml").into(),
            dependencies: dependencies
                .iter()
                .map(|(name, kind)| Dependency { name: (*name).into(), kind: kind.map(Into::into), optional: false })
                .collect(),
            targets: vec![Target { name: name.into(), kind: vec!["lib".into()] }],
            features: Default::default(),
            publish: Some(Vec::new()),
            description: None,
            keywords: Vec::new(),
            categories: Vec::new(),
        }
    }

    #[test]
    fn up_and_sideways_are_found_and_down_is_not() {
        assert!(directions(&package("qv-replay", &[("qv-core", None), ("qv-sim", None), ("serde", None)])).is_empty());
        assert_eq!(directions(&package("qv-sim", &[("qv-go2", None)])).len(), 1);
        assert_eq!(directions(&package("qv-sim", &[("qv-raster", None)])).len(), 1);
        assert_eq!(directions(&package("qv-core", &[("xtask", Some("build"))])).len(), 1);
        assert!(directions(&package("qv-sim", &[("qv-go2", Some("dev"))])).is_empty());
        assert_eq!(directions(&package("qv-new", &[])).len(), 1);
    }

    #[test]
    fn package_names_stand_for_crates() {
        assert!(directions(&package("quadverse-replay", &[("quadverse-sim", None)])).is_empty());
        assert_eq!(directions(&package("quadverse-sim", &[("quadverse-go2", None)])).len(), 1);
        assert_eq!(short("quadverse"), "qv");
        assert_eq!(short("quadversed"), "quadversed");
    }

    #[test]
    fn what_is_published_has_our_name_and_the_crates() {
        let mut sim = package("quadverse-sim", &[]);
        assert!(for_a_registry(&sim).is_empty(), "it is not published");
        sim.publish = None;
        sim.targets[0].name = "qv_sim".into();
        assert_eq!(for_a_registry(&sim).len(), 3, "nothing is said of it");
        sim.description = Some("A simulator.".into());
        (sim.keywords, sim.categories) = (vec!["robotics".into()], vec!["simulation".into()]);
        assert!(for_a_registry(&sim).is_empty());
        sim.targets[0].name = "quadverse_sim".into();
        assert_eq!(for_a_registry(&sim).len(), 1, "code calls it qv_sim");
        sim.name = "qv-sim".into();
        assert_eq!(for_a_registry(&sim).len(), 2, "a stranger may have that name");
    }

    #[test]
    fn wgpu_must_be_gated() {
        let mut raster = package("qv-raster", &[("wgpu", None)]);
        assert_eq!(gpu_gate(&raster).len(), 1);
        raster.dependencies[0].optional = true;
        raster.features.insert("gpu".into(), vec!["dep:wgpu".into()]);
        assert!(gpu_gate(&raster).is_empty());
        raster.features.insert("fast".into(), vec!["dep:wgpu".into()]);
        assert_eq!(gpu_gate(&raster).len(), 1);
    }

    #[test]
    fn a_bare_crate_is_incomplete() {
        let readme = Source { path: "README.md".into(), text: "- `qv-sim`: ...".into() };
        let found = completeness(&package("qv-sim", &[]), Path::new("/top"), &[readme]);
        assert_eq!(found.len(), 3, "no example, no page of its own, not in ARCHITECTURE.md: {found:?}");
    }

    #[test]
    fn a_crates_page_says_its_layer_and_an_example() {
        let mut sim = package("qv-sim", &[]);
        sim.targets = vec![Target { name: "drop".into(), kind: vec!["example".into()] }];
        let page = |text: &str| [Source { path: "crates/qv-sim/README.md".into(), text: text.into() }];
        let found = |text: &str| own_page(&sim, Path::new("/top"), &page(text));
        assert_eq!(found("cargo run -p quadverse-sim --example drop\n| layer | 1 of 7 |"), None);
        assert!(found("--example drop\n| layer | 2 of 7 |").unwrap().contains("`| layer | 1 of 7`"));
        assert!(found("--example fall\n| layer | 1 of 7 |").unwrap().ends_with("found fall"));
        assert!(found("| layer | 1 of 7 |").unwrap().ends_with("found none"));
    }
}
