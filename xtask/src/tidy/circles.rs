//! No circles of modules within a crate: what a file leans on must not lean on it, not even round a few corners.
//!
//! A file leans on the file that defines what its code names, not on those that pass the name on. To declare a module
//! or to pass on a name of it is not to lean on it. Calls of methods name no file and make no arrow.

use super::module_paths::{Import, Module, modules};
use super::rust_text::{Strings, code, without_tests};
use super::source::Source;
use crate::workspace::Workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// All findings about circles.
pub fn check(workspace: &Workspace, sources: &[Source]) -> Vec<String> {
    let texts: BTreeMap<&Path, &str> =
        sources.iter().map(|source| (source.path.as_path(), source.text.as_str())).collect();
    let mut found = Vec::new();
    for package in workspace.members() {
        let Ok(folder) = package.folder().strip_prefix(&workspace.workspace_root) else { continue };
        for root in ["lib.rs", "main.rs"] {
            let circles = circles(&texts, &folder.join("src").join(root));
            found.extend(circles.iter().map(|circle| format!("{}: {circle}", package.short())));
        }
    }
    found
}

/// Circles among the files that hang from `root`, the file of a crate, each in words: every arrow with one path that
/// makes it.
fn circles(texts: &BTreeMap<&Path, &str>, root: &Path) -> Vec<String> {
    let graph = Graph::read(texts, root);
    let arrows = graph.arrows();
    let edges: Vec<Vec<usize>> =
        (0..graph.files.len()).map(|from| arrows.keys().filter(|a| a.0 == from).map(|a| a.1).collect()).collect();
    let describe = |circle: Vec<usize>| {
        let within = arrows.iter().filter(|((from, to), _)| circle.contains(from) && circle.contains(to));
        let lines: Vec<String> = within
            .map(|((from, to), path)| {
                format!("\n    {} -> {}: {path}", graph.files[*from].display(), graph.files[*to].display())
            })
            .collect();
        format!("expected no circle of modules, found one of {} files:{}", circle.len(), lines.concat())
    };
    strongly_connected(&edges).into_iter().filter(|circle| circle.len() > 1).map(describe).collect()
}

/// Modules of a crate by their path from its root, and the files that hold them.
#[derive(Default)]
struct Graph {
    files: Vec<PathBuf>,
    modules: BTreeMap<Vec<String>, (usize, Module)>,
}

/// What a path stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Meaning {
    /// A module, by its path from the root of the crate.
    Module(Vec<String>),
    /// An item, by the number of the file that defines it.
    Item(usize),
}

/// Modules and names that were asked for already, so that names which pass each other on come to an end.
type VisitedNames = BTreeSet<(Vec<String>, String, bool)>;

impl Graph {
    fn read(texts: &BTreeMap<&Path, &str>, root: &Path) -> Self {
        let mut graph = Self::default();
        graph.add(texts, root, root.parent().unwrap_or(root), Vec::new());
        graph
    }

    /// Adds the modules of `file`, which stands at `place` and whose modules have their files in `folder`.
    fn add(&mut self, texts: &BTreeMap<&Path, &str>, file: &Path, folder: &Path, place: Vec<String>) {
        let Some(text) = texts.get(file) else { return };
        let number = self.files.len();
        self.files.push(file.into());
        for module in modules(&without_tests(&code(text, Strings::Blank))) {
            let inside = module.within.iter().fold(folder.to_owned(), |folder, name| folder.join(name));
            let place = [place.clone(), module.within.clone()].concat();
            for child in &module.children {
                let below = inside.join(child);
                let place = [place.clone(), vec![child.clone()]].concat();
                self.add(texts, &below.with_extension("rs"), &below, place.clone());
                self.add(texts, &below.join("mod.rs"), &below, place);
            }
            self.modules.insert(place, (number, module));
        }
    }

    /// Which file leans on which, by number, each with one path that says so.
    fn arrows(&self) -> BTreeMap<(usize, usize), String> {
        let mut found = BTreeMap::new();
        for (place, (from, module)) in &self.modules {
            let imports = module.imports.iter().filter(|import| !import.is_public);
            for path in imports.map(|import| &import.path).chain(&module.paths) {
                if let Some(Meaning::Item(to)) =
                    self.meaning(place, path, true, &mut VisitedNames::new()).filter(|to| *to != Meaning::Item(*from))
                {
                    found.entry((*from, to)).or_insert_with(|| path.join("::"));
                }
            }
        }
        found
    }

    /// What a path in the module at `place` stands for; `None` for what is not of this crate. Of a module and an item
    /// of the same name, the path means the item if `to_item`.
    fn meaning(&self, place: &[String], path: &[String], to_item: bool, asked: &mut VisitedNames) -> Option<Meaning> {
        let (first, rest) = path.split_first()?;
        let start = match first.as_str() {
            "crate" => Meaning::Module(Vec::new()),
            "self" => Meaning::Module(place.to_vec()),
            "super" => Meaning::Module(place[..place.len().checked_sub(1)?].to_vec()),
            _ => self.member(place, first, to_item && rest.is_empty(), asked)?,
        };
        rest.iter().enumerate().try_fold(start, |at, (number, name)| match at {
            Meaning::Item(_) => Some(at),
            Meaning::Module(at) if name == "super" => Some(Meaning::Module(at[..at.len().checked_sub(1)?].to_vec())),
            Meaning::Module(at) => {
                let is_last = to_item && number + 1 == rest.len();
                self.member(&at, name, is_last, asked)
            }
        })
    }

    /// What a name of the module at `place` stands for, if it declares the name or passes it on.
    fn member(&self, place: &[String], name: &str, is_last: bool, asked: &mut VisitedNames) -> Option<Meaning> {
        let (file, module) = self.modules.get(place)?;
        if !asked.insert((place.to_vec(), name.to_owned(), is_last)) {
            return None;
        }
        let child = [place, &[name.to_owned()]].concat();
        let child = || self.modules.contains_key(&child).then(|| Meaning::Module(child.clone()));
        let own = || module.items.iter().any(|item| item == name).then_some(Meaning::Item(*file));
        let named = || module.imports.iter().filter(|import| import.name == name);
        let stars = || module.imports.iter().filter(|import| import.name == "*");
        let first = if is_last { own() } else { child() };
        let next = first.or_else(|| named().find_map(|import| self.imported(place, import, is_last, asked)));
        let then = next.or_else(|| stars().find_map(|star| self.starred(place, star, name, is_last, asked)));
        then.or_else(own).or_else(child)
    }

    fn imported(&self, place: &[String], import: &Import, is_last: bool, asked: &mut VisitedNames) -> Option<Meaning> {
        // `use name;` would ask for itself.
        (import.path.len() > 1 || import.path[0] != import.name)
            .then(|| self.meaning(place, &import.path, is_last, asked))
            .flatten()
    }

    fn starred(
        &self,
        place: &[String],
        star: &Import,
        name: &str,
        is_last: bool,
        asked: &mut VisitedNames,
    ) -> Option<Meaning> {
        match self.meaning(place, &star.path, false, asked)? {
            Meaning::Module(at) if at != place => self.member(&at, name, is_last, asked),
            _ => None,
        }
    }
}

/// Strongly connected components of a graph, each sorted, by Tarjan's walk.
fn strongly_connected(edges: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let unseen = usize::MAX;
    let mut walk = Walk {
        edges,
        order: vec![unseen; edges.len()],
        lowest: vec![unseen; edges.len()],
        path: Vec::new(),
        found: Vec::new(),
        seen: 0,
    };
    for node in 0..edges.len() {
        if walk.order[node] == unseen {
            walk.visit(node);
        }
    }
    walk.found
}

struct Walk<'a> {
    edges: &'a [Vec<usize>],
    /// When each node was first seen.
    order: Vec<usize>,
    /// The earliest node on the path that each node reaches.
    lowest: Vec<usize>,
    path: Vec<usize>,
    found: Vec<Vec<usize>>,
    seen: usize,
}

impl Walk<'_> {
    fn visit(&mut self, node: usize) {
        (self.order[node], self.lowest[node]) = (self.seen, self.seen);
        self.seen += 1;
        self.path.push(node);
        for &next in &self.edges[node] {
            if self.order[next] == usize::MAX {
                self.visit(next);
                self.lowest[node] = self.lowest[node].min(self.lowest[next]);
            } else if self.path.contains(&next) {
                self.lowest[node] = self.lowest[node].min(self.order[next]);
            }
        }
        if self.lowest[node] == self.order[node] {
            let from = self.path.iter().position(|on| *on == node).unwrap_or_default();
            let mut component = self.path.split_off(from);
            component.sort_unstable();
            self.found.push(component);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(files: &[(&str, &str)]) -> Vec<String> {
        circles(&files.iter().map(|(path, text)| (Path::new(*path), *text)).collect(), Path::new("lib.rs"))
    }

    #[test]
    fn a_circle_is_found_with_its_arrows() {
        let files = [
            ("lib.rs", "mod a; mod b; mod c;"),
            ("a.rs", "use crate::b::B; pub fn a() {}"),
            ("b.rs", "pub struct B; fn f() { super::c::c(); }"),
            ("c.rs", "pub fn c() { crate::a::a() }"),
        ];
        let circles = found(&files);
        assert_eq!(circles.len(), 1);
        let said = &circles[0];
        assert!(said.starts_with("expected no circle of modules, found one of 3 files:"), "{said}");
        assert!(said.contains("\n    a.rs -> b.rs: crate::b::B") && said.contains("\n    b.rs -> c.rs: super::c::c"));
        assert!(found(&[files[0], files[1], files[2], ("c.rs", "pub fn c() {}")]).is_empty());
    }

    #[test]
    fn a_parent_that_calls_a_child_that_names_the_parent_is_a_circle() {
        let child = ("a/b.rs", "use super::A; pub fn b(_: A) {}");
        let parent = |text| [("lib.rs", "mod a;"), ("a/mod.rs", text), child];
        assert_eq!(found(&parent("mod b; pub struct A; fn f() { b::b(A) }")).len(), 1);
        assert_eq!(found(&parent("mod b; use b::b; pub struct A; fn f() { b(A) }")).len(), 1);
        assert!(found(&parent("mod b; pub use b::b; pub struct A;")).is_empty(), "passing on is not leaning");
        assert_eq!(found(&parent("mod b; pub use b::b; pub struct A; fn f() { b(A) }")).len(), 1);
    }

    #[test]
    fn names_that_are_passed_on_lead_to_what_defines_them() {
        let files = |root| {
            [("lib.rs", root), ("a.rs", "use crate::B; pub fn a() {}"), ("b.rs", "pub struct B; fn f() { crate::a() }")]
        };
        assert_eq!(found(&files("mod a; mod b; pub use a::a; pub use b::B;")).len(), 1);
        assert_eq!(found(&files("mod a; mod b; pub use self::{a::*, b::*};")).len(), 1);
        assert!(found(&files("mod a; mod b; pub struct B; pub fn a() {}")).is_empty());
    }

    #[test]
    fn a_star_stands_for_the_names_that_are_used() {
        let files = |body| [("lib.rs", "mod a; mod b;"), ("a.rs", "use crate::b::B; pub fn a() {}"), ("b.rs", body)];
        assert_eq!(found(&files("use super::a::*; pub struct B; fn f() { a() }")).len(), 1);
        assert!(found(&files("use super::a::*; pub struct B; fn f(x: X) { x.a() }")).is_empty());
    }

    #[test]
    fn what_is_written_about_code_and_what_tests_it_makes_no_arrow() {
        let files = |b| [("lib.rs", "mod a; mod b;"), ("a.rs", "use crate::b::B; pub fn a() {}"), ("b.rs", b)];
        assert!(found(&files("/// [`crate::a::a`]\npub struct B; // crate::a::a\n")).is_empty());
        assert!(found(&files("pub struct B;\n#[cfg(test)]\nmod tests { use crate::a::a; }")).is_empty());
    }
}
