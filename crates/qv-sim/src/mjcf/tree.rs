//! The elements of an MJCF, included files in their places, in one arena: no nesting is walked on the program's stack.

use crate::SimError;
use crate::urdf::{attributes, kinds, read::Lines};
use roxmltree::{Document, Node, NodeId, ParsingOptions};
use std::collections::HashMap;

/// Gives the text of a file that `<include>` names, or says why it cannot.
pub type Include<'a> = dyn Fn(&str) -> Result<String, String> + 'a;

/// More files than this are a loop of includes.
const MOST_FILES: usize = 64;

/// One element.
pub(super) struct Element {
    pub tag: String,
    pub attributes: Vec<(String, String)>,
    /// Indices of the elements inside, in the order of the file.
    pub children: Vec<usize>,
    file: usize,
    pub line: usize,
}

/// All elements; the first is the root.
pub(super) struct Tree {
    elements: Vec<Element>,
    /// Names of the included files, after the main one, which is the caller's to name.
    files: Vec<String>,
}

impl Tree {
    pub fn parse(xml: &str, include: &Include) -> Result<Self, SimError> {
        let mut tree = Self { elements: Vec::new(), files: vec![String::new()] };
        let root = Element { tag: "mujoco".into(), attributes: Vec::new(), children: Vec::new(), file: 0, line: 1 };
        tree.elements.push(root);
        tree.add(xml, 0, 0, include)?;
        Ok(tree)
    }

    /// Adds what a file holds below element `parent`.
    fn add(&mut self, xml: &str, file: usize, parent: usize, include: &Include) -> Result<(), SimError> {
        let xml = xml.trim_start_matches('\u{feff}');
        let within = |found: String| match file {
            0 => SimError::Mjcf { element: "file".into(), expected: "the root <mujoco>".into(), found },
            _ => SimError::Mjcf {
                element: format!("<include> of `{}`", self.files[file]),
                expected: "the root <mujoco> or <mujocoinclude>".into(),
                found,
            },
        };
        attributes::check(xml).map_err(within)?;
        let options = ParsingOptions { allow_dtd: true, ..Default::default() };
        let document =
            Document::parse_with_options(xml, options).map_err(|e| within(kinds::of_text(xml, &e.to_string())))?;
        let root = document.root_element();
        match (root.tag_name().name(), file) {
            ("mujoco", _) => {}
            ("mujocoinclude", 1..) => {}
            (other, _) => return Err(within(kinds::of_root(other))),
        }
        let lines = Lines::new(xml);
        let attributes = |node: Node| node.attributes().map(|a| (a.name().to_owned(), a.value().to_owned())).collect();
        if file == 0 {
            (self.elements[0].attributes, self.elements[0].line) = (attributes(root), lines.of(root));
        }
        let mut places: HashMap<NodeId, usize> = HashMap::from([(root.id(), parent)]);
        for node in root.descendants().skip(1).filter(Node::is_element) {
            // What an <include> holds has no place: it is replaced.
            let Some(&parent) = node.parent().and_then(|p| places.get(&p.id())) else { continue };
            let line = lines.of(node);
            if node.tag_name().name() == "include" {
                self.include(node.attribute("file"), file, line, parent, include)?;
                continue;
            }
            let tag = node.tag_name().name().to_owned();
            let index = self.elements.len();
            self.elements.push(Element { tag, attributes: attributes(node), children: Vec::new(), file, line });
            self.elements[parent].children.push(index);
            places.insert(node.id(), index);
        }
        Ok(())
    }

    fn include(
        &mut self,
        name: Option<&str>,
        file: usize,
        line: usize,
        parent: usize,
        include: &Include,
    ) -> Result<(), SimError> {
        let place = self.place_of(file, line);
        let wrong = |expected: &str, found: String| SimError::Mjcf {
            element: "<include>".into(),
            expected: expected.into(),
            found: format!("{found} {place}"),
        };
        let name = name.ok_or_else(|| wrong("an attribute `file`", "none".into()))?;
        if self.files.iter().any(|known| known == name) {
            return Err(wrong("each file once", format!("`{name}` again")));
        }
        if self.files.len() > MOST_FILES {
            return Err(wrong(&format!("at most {MOST_FILES} files"), format!("`{name}` as one more")));
        }
        let text = include(name).map_err(|reason| wrong(&format!("the file `{name}`"), reason))?;
        self.files.push(name.to_owned());
        self.add(&text, self.files.len() - 1, parent, include)
    }

    pub fn element(&self, index: usize) -> &Element {
        &self.elements[index]
    }

    pub fn attribute(&self, index: usize, name: &str) -> Option<&str> {
        self.elements[index].attributes.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// Children of the root's children of that tag: sections may come more than once.
    pub fn section(&self, tag: &str) -> Vec<usize> {
        self.sections(tag).flat_map(|s| self.elements[s].children.iter().copied()).collect()
    }

    /// The root's children of that tag.
    pub fn sections<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = usize> + 'a {
        self.elements[0].children.iter().copied().filter(move |&c| self.elements[c].tag == tag)
    }

    /// "(line 3)", or "(line 3 of `arm.xml`)".
    pub fn place(&self, index: usize) -> String {
        self.place_of(self.elements[index].file, self.elements[index].line)
    }

    fn place_of(&self, file: usize, line: usize) -> String {
        if file == 0 { format!("(line {line})") } else { format!("(line {line} of `{}`)", self.files[file]) }
    }

    /// The element for messages: its tag, and its name where it has one.
    pub fn label(&self, index: usize) -> String {
        let tag = &self.elements[index].tag;
        self.attribute(index, "name").map_or_else(|| format!("<{tag}>"), |name| format!("{tag} `{name}`"))
    }

    pub fn error(&self, index: usize, expected: impl Into<String>, found: impl std::fmt::Display) -> SimError {
        let found = format!("{found} {}", self.place(index));
        SimError::Mjcf { element: self.label(index), expected: expected.into(), found }
    }
}
