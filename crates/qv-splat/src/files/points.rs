//! Coloured points as PLY: what structure from motion gives.

use super::ply_header::Header;
use crate::SplatError;
use crate::error::off;

/// Points with colours.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    /// Shape `[N, 3]` \[m\].
    pub places: Vec<[f32; 3]>,
    /// Red, green, blue from 0 to 1, shape `[N, 3]`.
    pub colours: Vec<[f32; 3]>,
    /// Points of the file that are not here: their numbers are not finite, or beyond [`FARTHEST`].
    pub left_out: usize,
}

/// Farthest from the origin that a point may be along an axis \[m\]: squares of more are not finite in single precision.
pub const FARTHEST: f32 = 1e9;

impl Points {
    /// Takes a point in, if it is of use.
    pub fn push(&mut self, place: [f32; 3], colour: [f32; 3]) {
        if place.iter().all(|x| x.abs() <= FARTHEST) {
            self.places.push(place);
            self.colours.push(colour.map(|c| c.clamp(0.0, 1.0)));
        } else {
            self.left_out += 1;
        }
    }
}

/// Reads `x y z` and, as bytes, `red green blue` of the element `vertex` of a PLY, binary or, as nerfstudio writes it, of text. Points
/// without colours are grey; those with numbers that are not finite, or too far to be of use, are counted as left out.
///
/// # Errors
/// The header or its counts are off, or a coordinate is missing.
pub fn read(bytes: &[u8]) -> Result<Points, SplatError> {
    if let Some(text) = text_of(bytes) {
        return read_text(&text);
    }
    let header = Header::parse(bytes)?;
    let element = header.element("vertex")?;
    let place = [element.property("x")?, element.property("y")?, element.property("z")?];
    let colour = ["red", "green", "blue"].map(|name| element.property(name).ok());
    let mut points = Points::default();
    for row in element.rows(bytes) {
        let colour = colour.map(|property| property.map_or(0.5, |p| p.value(row) / 255.0));
        points.push(place.map(|property| property.value(row)), colour);
    }
    Ok(points)
}

/// The contents of a PLY of text.
fn text_of(bytes: &[u8]) -> Option<std::borrow::Cow<'_, str>> {
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]);
    let is_text = start.lines().take(4).any(|line| line.trim_end() == "format ascii 1.0");
    is_text.then(|| String::from_utf8_lossy(bytes))
}

/// Points of a PLY of text whose first element is `vertex`.
fn read_text(text: &str) -> Result<Points, SplatError> {
    let mut lines = text.lines().map(str::trim).enumerate();
    let (mut count, mut names, mut of_vertex) = (None, vec![], false);
    for (_, line) in lines.by_ref().take_while(|(_, line)| *line != "end_header") {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["element", "vertex", n] => (count, of_vertex) = (n.parse::<usize>().ok(), true),
            ["element", ..] if count.is_none() => return Err(off("PLY of text", "the element vertex first", line)),
            // What comes after the vertices is not read.
            ["element", ..] => of_vertex = false,
            ["property", _, name] if of_vertex => names.push(name),
            _ => {}
        }
    }
    let count = count.ok_or_else(|| off("PLY of text", "element vertex with a count", "none"))?;
    let column = |name: &str| names.iter().position(|known| *known == name);
    let needed =
        |name: &str| column(name).ok_or_else(|| off("PLY of text", format!("property {name}"), names.join(", ")));
    let place = [needed("x")?, needed("y")?, needed("z")?];
    let colour = ["red", "green", "blue"].map(column);
    let mut points = Points::default();
    for index in 0..count {
        let (number, line) = lines.next().ok_or_else(|| off("PLY of text", format!("{count} points"), index))?;
        let values: Vec<Option<f32>> = line.split_whitespace().map(|word| word.parse().ok()).collect();
        let value = |k: usize| values.get(k).copied().flatten();
        let [Some(x), Some(y), Some(z)] = place.map(value) else {
            return Err(off(format!("PLY of text, line {}", number + 1), "x, y and z", line));
        };
        points.push([x, y, z], colour.map(|column| column.and_then(value).map_or(0.5, |c| c / 255.0)));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn points_and_colours_are_read() {
        let mut file = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
            property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
            .to_vec();
        for x in [1.0f32, f32::NAN, 1e20] {
            [x, 2.0, 3.0].iter().for_each(|v| file.extend(v.to_le_bytes()));
            file.extend([255, 0, 51]);
        }
        let points = read(&file).unwrap();
        assert_eq!(points, Points { places: vec![[1.0, 2.0, 3.0]], colours: vec![[1.0, 0.0, 0.2]], left_out: 2 });
        assert!(read(&file[..file.len() - 1]).is_err());
    }

    #[test]
    fn a_file_of_text_is_read_too() {
        let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
            property uint8 red\nproperty uint8 green\nproperty uint8 blue\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n";
        let points = read(format!("{head}1 2 3 255 0 51\n4 nan 6 1 2 3\n").as_bytes()).unwrap();
        assert_eq!(points, Points { places: vec![[1.0, 2.0, 3.0]], colours: vec![[1.0, 0.0, 0.2]], left_out: 1 });
        let error = read(format!("{head}1 2 3 255 0 51\n4 5\n").as_bytes()).unwrap_err().to_string();
        assert!(error.states("line 14 4 5"), "{error}");
        let error = read(format!("{head}1 2 3 255 0 51\n").as_bytes()).unwrap_err().to_string();
        assert!(error.states("points 2 1"), "{error}");
        let error = read(head.replace("float y", "float w").as_bytes()).unwrap_err().to_string();
        assert!(error.states("property"), "{error}");
    }
}
