//! Changing parts of a robot's XML in place: what is not named stays as it is, byte by byte.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::fmt::Write;
use std::ops::Range;

/// Attributes to set in one child of one joint.
#[derive(Debug, Clone)]
struct AttributeEdit {
    joint: String,
    element: &'static str,
    values: Vec<(&'static str, f64)>,
}

/// What to change, by names of joints and links right under the root.
#[derive(Debug, Clone, Default)]
pub(super) struct Edits {
    attributes: Vec<AttributeEdit>,
    inertials: Vec<(String, Option<String>)>,
}

impl Edits {
    /// Sets attributes of the child `element` of a joint, which is made if need be. Nothing happens without values.
    pub fn set_attributes(&mut self, joint: &str, element: &'static str, values: Vec<(&'static str, f64)>) {
        if !values.is_empty() {
            self.attributes.push(AttributeEdit { joint: joint.to_owned(), element, values });
        }
    }

    /// Puts `element` in place of a link's `<inertial>`; `None` takes it away.
    pub fn set_inertial(&mut self, link: &str, element: Option<String>) {
        self.inertials.push((link.to_owned(), element));
    }
}

/// The text with the edits made.
///
/// # Errors
/// Says what is wrong with the XML.
pub(super) fn write_edits(text: &str, edits: &Edits) -> Result<String, String> {
    let mut walk = Walk { text, edits, path: Vec::new(), splices: Vec::new(), open: None };
    let mut reader = Reader::from_str(text);
    loop {
        let start = position(&reader);
        let event = reader.read_event().map_err(|e| format!("{e} at byte {}", reader.error_position()))?;
        let span = start..position(&reader);
        match event {
            Event::Start(tag) => {
                walk.enter(&tag, span, false)?;
                walk.path.push(name_of(&tag));
            }
            Event::Empty(tag) => walk.enter(&tag, span, true)?,
            Event::End(_) => {
                walk.path.pop();
                walk.leave(span);
            }
            Event::Eof => break,
            _ => {}
        }
    }
    Ok(spliced(text, &walk.splices))
}

fn position(reader: &Reader<&[u8]>) -> usize {
    usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX)
}

fn name_of(tag: &BytesStart) -> String {
    String::from_utf8_lossy(tag.name().as_ref()).into_owned()
}

/// The joint or link that is being read.
struct OpenElement {
    is_joint: bool,
    name: String,
    /// Children that were met.
    met: Vec<String>,
    /// Where a child that is being replaced began.
    replaced_from: Option<usize>,
}

struct Walk<'a> {
    text: &'a str,
    edits: &'a Edits,
    /// Names of the elements around the current place.
    path: Vec<String>,
    /// Ranges of the text and what to put there.
    splices: Vec<(Range<usize>, String)>,
    open: Option<OpenElement>,
}

impl Walk<'_> {
    fn enter(&mut self, tag: &BytesStart, span: Range<usize>, is_empty: bool) -> Result<(), String> {
        let element = name_of(tag);
        // Joints are also named deeper, by transmissions and plugins.
        if self.path.len() == 1 && !is_empty && (element == "joint" || element == "link") {
            let name = attribute(tag, "name")?.unwrap_or_default();
            self.open = Some(OpenElement { is_joint: element == "joint", name, met: Vec::new(), replaced_from: None });
            return Ok(());
        }
        let Some(open) = self.open.as_mut().filter(|_| self.path.len() == 2) else { return Ok(()) };
        if open.met.contains(&element) {
            return Ok(());
        }
        open.met.push(element.clone());
        if open.is_joint {
            let named = |e: &&AttributeEdit| e.joint == open.name && e.element == element;
            if let Some(edit) = self.edits.attributes.iter().find(named) {
                self.splices.push((span, tag_with(tag, &edit.values, is_empty)?));
            }
        } else if element == "inertial" && self.edits.inertials.iter().any(|(link, _)| *link == open.name) {
            open.replaced_from = Some(span.start);
            if is_empty {
                self.replace_inertial(span.end);
            }
        }
        Ok(())
    }

    /// At the end of an element; `path` is what is around it.
    fn leave(&mut self, span: Range<usize>) {
        if self.path.len() == 2 && self.open.as_ref().is_some_and(|o| o.replaced_from.is_some()) {
            self.replace_inertial(span.end);
        } else if self.path.len() == 1
            && let Some(open) = self.open.take()
        {
            self.add_missing(&open, span.start);
        }
    }

    fn replace_inertial(&mut self, end: usize) {
        let Some(open) = self.open.as_mut() else { return };
        let element = self.edits.inertials.iter().find(|(link, _)| *link == open.name).and_then(|(_, e)| e.clone());
        if let Some(start) = open.replaced_from.take() {
            self.splices.push((start..end, element.unwrap_or_default()));
        }
    }

    /// Children that should have been there, before the end tag at `end`.
    fn add_missing(&mut self, open: &OpenElement, end: usize) {
        let line = self.text[..end].rsplit('\n').next().unwrap_or_default();
        let indent = if line.trim().is_empty() && line.len() < end { Some(line) } else { None };
        let mut missing: Vec<String> = Vec::new();
        if open.is_joint {
            let named = self.edits.attributes.iter().filter(|e| e.joint == open.name);
            for edit in named.filter(|e| !open.met.iter().any(|m| m == e.element)) {
                let values: String = edit.values.iter().map(|(key, value)| format!(" {key}=\"{value}\"")).collect();
                missing.push(format!("<{}{values}/>", edit.element));
            }
        } else if !open.met.iter().any(|m| m == "inertial") {
            let named = self.edits.inertials.iter().filter(|(link, _)| *link == open.name);
            missing.extend(named.filter_map(|(_, element)| element.clone()));
        }
        for element in missing {
            let laid_out = indent.map_or(element.clone(), |indent| format!("  {element}\n{indent}"));
            self.splices.push((end..end, laid_out));
        }
    }
}

fn attribute(tag: &BytesStart, name: &str) -> Result<Option<String>, String> {
    let found = tag.try_get_attribute(name).map_err(|e| e.to_string())?;
    found.map(|a| a.unescape_value().map(|v| v.into_owned()).map_err(|e| e.to_string())).transpose()
}

/// The start tag with the values set; its other attributes as they were, in their order.
fn tag_with(tag: &BytesStart, values: &[(&str, f64)], is_empty: bool) -> Result<String, String> {
    let mut out = format!("<{}", name_of(tag));
    let mut left: Vec<&(&str, f64)> = values.iter().collect();
    for found in tag.attributes() {
        let found = found.map_err(|e| e.to_string())?;
        let key = String::from_utf8_lossy(found.key.as_ref()).into_owned();
        let raw = String::from_utf8_lossy(&found.value).into_owned();
        let value = match left.iter().position(|(k, _)| *k == key) {
            Some(at) => left.remove(at).1.to_string(),
            None => raw,
        };
        // A raw value may hold one kind of quotes, never both.
        let quote = if value.contains('"') { '\'' } else { '"' };
        let _ = write!(out, " {key}={quote}{value}{quote}");
    }
    for (key, value) in left {
        let _ = write!(out, " {key}=\"{value}\"");
    }
    Ok(out + if is_empty { "/>" } else { ">" })
}

/// Splices come in the order of the text and do not overlap.
fn spliced(text: &str, splices: &[(Range<usize>, String)]) -> String {
    let mut out = String::with_capacity(text.len() + 256);
    let mut at = 0;
    for (range, replacement) in splices {
        out += &text[at..range.start];
        out += replacement;
        at = range.end;
    }
    out + &text[at..]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edits() -> Edits {
        let mut edits = Edits::default();
        edits.set_attributes("knee", "dynamics", vec![("friction", 0.25)]);
        edits.set_attributes("knee", "limit", vec![("effort", 12.0)]);
        edits.set_inertial("shank", Some("<inertial>new</inertial>".into()));
        edits.set_inertial("foot", None);
        edits
    }

    #[test]
    fn only_what_is_named_changes() {
        let text = "<?xml version='1.0'?>\n<!-- <joint name=\"knee\"><limit effort=\"1\"/></joint> -->\n<robot name=\"r\">\n\
            <link name=\"shank\"><inertial><mass value=\"1\"/></inertial><visual/></link>\n\
            <link name=\"foot\" ><inertial/></link>\n\
            <joint name='knee' type=\"revolute\">\n  <limit  lower='-1' effort=\"40\" velocity=\"20\" />\n</joint>\n\
            <transmission><joint name=\"knee\"><limit effort=\"1\"/></joint></transmission>\n\
            <note a=\"&lt;&quot;\">x &amp; y</note><![CDATA[<joint name=\"knee\">]]></robot>\n<!-- end -->";
        let expected = text
            .replace("<inertial><mass value=\"1\"/></inertial>", "<inertial>new</inertial>")
            .replace("<inertial/>", "")
            .replace(
                "<limit  lower='-1' effort=\"40\" velocity=\"20\" />\n",
                "<limit lower=\"-1\" effort=\"12\" velocity=\"20\"/>\n  <dynamics friction=\"0.25\"/>\n",
            );
        assert_eq!(write_edits(text, &edits()).unwrap(), expected);
        assert_eq!(write_edits(text, &Edits::default()).unwrap(), text);
    }

    #[test]
    fn missing_children_are_made() {
        let text = "<robot><link name=\"shank\"></link><joint name=\"knee\"></joint></robot>";
        let expected = "<robot><link name=\"shank\"><inertial>new</inertial></link>\
            <joint name=\"knee\"><dynamics friction=\"0.25\"/><limit effort=\"12\"/></joint></robot>";
        assert_eq!(write_edits(text, &edits()).unwrap(), expected);
    }

    #[test]
    fn broken_text_is_named() {
        for text in ["<robot><joint name=\"knee\"></robot>", "<robot", "<robot><joint name=></joint></robot>"] {
            assert!(write_edits(text, &edits()).is_err(), "{text}");
        }
    }
}
