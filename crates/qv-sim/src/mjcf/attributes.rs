//! Attributes of an element, with those of its default classes behind them.

use super::tree::Tree;
use crate::SimError;
use std::collections::HashMap;

/// The default classes: <https://mujoco.readthedocs.io/en/stable/modeling.html#default-settings>.
pub(super) struct Classes {
    /// Elements <default> of each class; the top one, `main`, may come in several parts.
    elements: Vec<Vec<usize>>,
    parents: Vec<Option<usize>>,
    names: HashMap<String, usize>,
}

impl Classes {
    pub fn read(tree: &Tree) -> Result<Self, SimError> {
        let mut classes =
            Self { elements: vec![Vec::new()], parents: vec![None], names: HashMap::from([("main".to_owned(), 0)]) };
        let mut pending = Vec::new();
        for top in tree.sections("default") {
            if let Some(name) = tree.attribute(top, "class") {
                classes.names.insert(name.to_owned(), 0);
            }
            classes.elements[0].push(top);
            pending.push((top, 0));
        }
        while let Some((element, class)) = pending.pop() {
            for &child in tree.element(element).children.iter().filter(|&&c| tree.element(c).tag == "default") {
                let name = tree.attribute(child, "class");
                let name = name.ok_or_else(|| tree.error(child, "an attribute `class`", "none"))?;
                let index = classes.elements.len();
                if classes.names.insert(name.to_owned(), index).is_some() {
                    return Err(tree.error(child, "a class of its own", format!("`{name}` again")));
                }
                classes.elements.push(vec![child]);
                classes.parents.push(Some(class));
                pending.push((child, index));
            }
        }
        Ok(classes)
    }

    /// The class that `element` names, else `inherited`.
    pub fn of(&self, tree: &Tree, element: usize, inherited: usize) -> Result<usize, SimError> {
        self.named(tree, element, "class", inherited)
    }

    /// The class of what is inside a body or frame.
    pub fn inside(&self, tree: &Tree, element: usize, inherited: usize) -> Result<usize, SimError> {
        self.named(tree, element, "childclass", inherited)
    }

    fn named(&self, tree: &Tree, element: usize, attribute: &str, inherited: usize) -> Result<usize, SimError> {
        let Some(name) = tree.attribute(element, attribute) else { return Ok(inherited) };
        let expected = || tree.error(element, "a default class that exists", format!("`{name}`"));
        self.names.get(name).copied().ok_or_else(expected)
    }

    /// Elements with one of the tags in a class and those around it, the nearest first.
    pub fn layers(&self, tree: &Tree, class: usize, tags: &[&str]) -> Vec<usize> {
        let mut layers = Vec::new();
        let mut at = Some(class);
        while let Some(class) = at {
            for &element in self.elements[class].iter().rev() {
                let children = tree.element(element).children.iter().rev();
                layers.extend(children.copied().filter(|&c| tags.contains(&tree.element(c).tag.as_str())));
            }
            at = self.parents[class];
        }
        layers
    }
}

/// The attributes of one element and, behind them, of its defaults.
pub(super) struct Attributes<'a> {
    pub tree: &'a Tree,
    /// The element itself first.
    pub layers: Vec<usize>,
}

impl<'a> Attributes<'a> {
    /// Those of `element`, whose class is its own or `inherited`.
    pub fn new(tree: &'a Tree, classes: &Classes, element: usize, inherited: usize) -> Result<Self, SimError> {
        let class = classes.of(tree, element, inherited)?;
        let mut layers = vec![element];
        layers.extend(classes.layers(tree, class, &[&tree.element(element).tag]));
        Ok(Self { tree, layers })
    }

    /// Those of an element alone.
    pub fn plain(tree: &'a Tree, element: usize) -> Self {
        Self { tree, layers: vec![element] }
    }

    pub fn element(&self) -> usize {
        self.layers[0]
    }

    pub fn text(&self, name: &str) -> Option<&'a str> {
        self.layers.iter().find_map(|&layer| self.tree.attribute(layer, name))
    }

    pub fn number(&self, name: &str) -> Result<Option<f64>, SimError> {
        Ok(self.numbers(name, 1, 1)?.map(|v| v[0]))
    }

    pub fn number_or(&self, name: &str, absent: f64) -> Result<f64, SimError> {
        Ok(self.number(name)?.unwrap_or(absent))
    }

    pub fn vector<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, SimError> {
        Ok(self.numbers(name, N, N)?.map(|v| std::array::from_fn(|i| v[i])))
    }

    /// `least` to `most` finite numbers. A nearer layer with fewer of them overwrites the first ones of the layers behind.
    pub fn numbers(&self, name: &str, least: usize, most: usize) -> Result<Option<Vec<f64>>, SimError> {
        let mut found: Option<Vec<f64>> = None;
        for &layer in self.layers.iter().rev() {
            let Some(text) = self.tree.attribute(layer, name) else { continue };
            let numbers = parse(text).filter(|n| (least..=most).contains(&n.len()));
            let numbers = numbers.ok_or_else(|| {
                let count = if least == most { format!("{least}") } else { format!("{least} to {most}") };
                let expected = format!("{count} finite number{} as `{name}`", if most == 1 { "" } else { "s" });
                self.tree.error(layer, expected, format!("`{text}`"))
            })?;
            let whole = found.get_or_insert_default();
            let kept = whole.len().max(numbers.len());
            whole.resize(kept, 0.0);
            whole[..numbers.len()].copy_from_slice(&numbers);
        }
        Ok(found)
    }

    /// `true` or `false`; `None` for `auto` or where it is absent.
    pub fn switch(&self, name: &str) -> Result<Option<bool>, SimError> {
        match self.text(name) {
            None | Some("auto") => Ok(None),
            Some("true") => Ok(Some(true)),
            Some("false") => Ok(Some(false)),
            Some(other) => Err(self.error(format!("true, false or auto as `{name}`"), format!("`{other}`"))),
        }
    }

    /// A range that holds: `None` where there is none, or it is switched off.
    pub fn range(&self, name: &str, switch: &str, autolimits: bool) -> Result<Option<[f64; 2]>, SimError> {
        let range = self.vector::<2>(name)?;
        // What is zero at both ends is what MuJoCo has for none.
        let is_on = self.switch(switch)?.unwrap_or(autolimits && range.is_some_and(|r| r != [0.0; 2]));
        match range.filter(|_| is_on) {
            Some([low, high]) if low >= high => {
                Err(self.error(format!("a `{name}` that rises"), format!("{low} to {high}")))
            }
            None if is_on => Err(self.error(format!("an attribute `{name}`"), "none")),
            range => Ok(range),
        }
    }

    pub fn error(&self, expected: impl Into<String>, found: impl std::fmt::Display) -> SimError {
        self.tree.error(self.element(), expected, found)
    }
}

/// Finite numbers with blanks between them.
pub(super) fn parse(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace().map(|word| word.parse().ok().filter(|x: &f64| x.is_finite())).collect()
}
