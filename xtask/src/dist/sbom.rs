//! A list of what is inside (CycloneDX 1.5, JSON), from what cargo resolves.

use super::build::FEATURES;
use crate::process;
use crate::workspace::Workspace;
use anyhow::{Context, Result};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Packages that are given away.
const ROOTS: [&str; 2] = ["quadverse", "qv-py"];
/// Processors that they are built for; the list has what any of them needs.
const PLATFORMS: [&str; 4] = [
    "x86_64-unknown-linux-gnu",
    "x86_64-unknown-linux-musl",
    "aarch64-unknown-linux-gnu",
    "aarch64-unknown-linux-musl",
];

/// The part of `cargo metadata` that is used here.
#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
    resolve: Resolve,
}

#[derive(Deserialize)]
struct Package {
    id: String,
    name: String,
    version: String,
    license: Option<String>,
    description: Option<String>,
    source: Option<String>,
}

#[derive(Deserialize)]
struct Resolve {
    nodes: Vec<Node>,
}

#[derive(Deserialize)]
struct Node {
    id: String,
    deps: Vec<Edge>,
}

#[derive(Deserialize)]
struct Edge {
    pkg: String,
    dep_kinds: Vec<Kind>,
}

/// `None` for what is linked, else `dev` or `build`.
#[derive(Deserialize)]
struct Kind {
    kind: Option<String>,
}

/// Packages by their purl, with those that they use.
type Graph = BTreeMap<String, (Value, BTreeSet<String>)>;

/// Writes `quadverse-VERSION.cdx.json`.
///
/// # Errors
/// Cargo fails, or the file cannot be written.
pub fn write(workspace: &Workspace, folder: &Path) -> Result<()> {
    let mut graph = Graph::new();
    for platform in PLATFORMS {
        add(&mut graph, &metadata(platform)?);
    }
    let version = workspace.version()?;
    let file = folder.join(format!("quadverse-{version}.cdx.json"));
    let beside = file.with_extension("part");
    let text = format!("{:#}\n", document(&graph, version));
    fs::write(&beside, text).with_context(|| format!("writing {}", beside.display()))?;
    fs::rename(&beside, &file).with_context(|| format!("writing {}", file.display()))?;
    println!("{}: {} packages", file.file_name().unwrap_or_default().to_string_lossy(), graph.len());
    Ok(())
}

fn metadata(platform: &str) -> Result<Metadata> {
    let mut cargo = process::cargo();
    let features = format!("quadverse/{FEATURES}");
    cargo.args(["metadata", "--format-version", "1", "--locked", "--features", &features]);
    let json = process::output(cargo.args(["--filter-platform", platform]))?;
    serde_json::from_str(&json).context("cargo metadata: unexpected shape")
}

/// Adds all that the roots link, on one platform.
fn add(graph: &mut Graph, metadata: &Metadata) {
    let packages: BTreeMap<&str, &Package> = metadata.packages.iter().map(|p| (p.id.as_str(), p)).collect();
    let nodes: BTreeMap<&str, &Node> = metadata.resolve.nodes.iter().map(|n| (n.id.as_str(), n)).collect();
    let is_root = |package: &&Package| package.source.is_none() && ROOTS.contains(&package.name.as_str());
    let mut open: Vec<&str> = metadata.packages.iter().filter(is_root).map(|p| p.id.as_str()).collect();
    let mut visited = BTreeSet::new();
    while let Some(id) = open.pop() {
        if !visited.insert(id) {
            continue;
        }
        let (Some(package), Some(node)) = (packages.get(id), nodes.get(id)) else { continue };
        let linked = node.deps.iter().filter(|edge| edge.dep_kinds.iter().any(|kind| kind.kind.is_none()));
        let linked: Vec<&str> = linked.map(|edge| edge.pkg.as_str()).collect();
        let names = linked.iter().filter_map(|id| packages.get(id)).map(|package| purl(package));
        graph.entry(purl(package)).or_insert_with(|| (component(package), BTreeSet::new())).1.extend(names);
        open.extend(linked);
    }
}

/// The address of a package in the notation of package-url.
fn purl(package: &Package) -> String {
    format!("pkg:cargo/{}@{}", package.name, package.version.replace('+', "%2B"))
}

fn component(package: &Package) -> Value {
    let purl = purl(package);
    let mut component = json!({
        "type": "library", "bom-ref": purl, "name": package.name, "version": package.version, "purl": purl, "scope": "required",
    });
    if let Some(license) = &package.license {
        // Older manifests write OR as a slash, which SPDX does not know.
        component["licenses"] = json!([{ "expression": license.replace('/', " OR ") }]);
    }
    if let Some(description) = &package.description {
        component["description"] = json!(description.trim());
    }
    component
}

fn document(graph: &Graph, version: &str) -> Value {
    let components: Vec<&Value> = graph.values().map(|(component, _)| component).collect();
    let dependencies: Vec<Value> =
        graph.iter().map(|(purl, (_, uses))| json!({ "ref": purl, "dependsOn": uses })).collect();
    json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": { "component": { "type": "application", "bom-ref": "quadverse", "name": "quadverse", "version": version } },
        "components": components,
        "dependencies": dependencies,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const METADATA: &str = r#"{"packages": [
        {"id": "1", "name": "quadverse", "version": "0.2.0", "license": "MIT OR Apache-2.0", "description": null, "source": null},
        {"id": "2", "name": "lz4-sys", "version": "1.11.1+lz4-1.10.0", "license": "MIT/Apache-2.0", "description": " C ", "source": "r"},
        {"id": "3", "name": "cc", "version": "1.0.0", "license": "MIT", "description": null, "source": "r"}],
        "resolve": {"nodes": [
        {"id": "1", "deps": [{"pkg": "2", "dep_kinds": [{"kind": null}]}, {"pkg": "3", "dep_kinds": [{"kind": "dev"}]}]},
        {"id": "2", "deps": [{"pkg": "3", "dep_kinds": [{"kind": "build"}]}]},
        {"id": "3", "deps": []}]}}"#;

    #[test]
    fn what_is_linked_is_listed_once_and_what_only_builds_is_not() {
        let metadata: Metadata = serde_json::from_str(METADATA).unwrap();
        let mut graph = Graph::new();
        add(&mut graph, &metadata);
        add(&mut graph, &metadata);
        let document = document(&graph, "0.2.0");
        let names: Vec<&str> =
            document["components"].as_array().unwrap().iter().map(|c| c["name"].as_str().unwrap()).collect();
        assert_eq!(names, ["lz4-sys", "quadverse"]);
        let lz4 = &document["components"][0];
        assert_eq!(lz4["purl"], "pkg:cargo/lz4-sys@1.11.1%2Blz4-1.10.0");
        assert_eq!(lz4["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert_eq!(document["dependencies"][1]["dependsOn"], json!([lz4["purl"]]));
    }
}
