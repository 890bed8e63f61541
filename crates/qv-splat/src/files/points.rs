//! Coloured points as PLY: what structure from motion gives.

use super::ply_header::Header;
use crate::SplatError;

/// Points with colours.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    /// Shape `[N, 3]` \[m\].
    pub places: Vec<[f32; 3]>,
    /// Red, green, blue from 0 to 1, shape `[N, 3]`.
    pub colours: Vec<[f32; 3]>,
}

/// Reads `x y z` and, as bytes, `red green blue` of the element `vertex` of a binary PLY. Points without colours are grey; those with numbers
/// that are not finite are left out.
///
/// # Errors
/// The header or its counts are off, or a coordinate is missing.
pub fn read(bytes: &[u8]) -> Result<Points, SplatError> {
    let header = Header::parse(bytes)?;
    let element = header.element("vertex")?;
    let place = [element.property("x")?, element.property("y")?, element.property("z")?];
    let colour = ["red", "green", "blue"].map(|name| element.property(name).ok());
    let mut points = Points::default();
    for row in element.rows(bytes) {
        let at = place.map(|property| property.value(row));
        if at.iter().all(|x| x.is_finite()) {
            points.places.push(at);
            points
                .colours
                .push(colour.map(|property| property.map_or(0.5, |p| (p.value(row) / 255.0).clamp(0.0, 1.0))));
        }
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_colours_are_read() {
        let mut file = b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
            property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
            .to_vec();
        for x in [1.0f32, f32::NAN] {
            [x, 2.0, 3.0].iter().for_each(|v| file.extend(v.to_le_bytes()));
            file.extend([255, 0, 51]);
        }
        let points = read(&file).unwrap();
        assert_eq!(points, Points { places: vec![[1.0, 2.0, 3.0]], colours: vec![[1.0, 0.0, 0.2]] });
        assert!(read(&file[..file.len() - 1]).is_err());
    }
}
