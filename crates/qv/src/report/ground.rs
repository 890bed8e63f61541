//! The ground from above, each label in a colour of its own, lit from the side; the robot's way over it.

use glam::{DVec2, DVec3};
use qv_core::{TriangleMesh, label_colour};
use serde_json::Value;
use std::fmt::Write;

/// Longer side of the picture \[pixels\].
const SIDE: usize = 640;
/// A picture from above with y up, and the part of the world that it shows.
pub struct FromAbove {
    /// RGB, shape `[height, width, 3]`, rows from the largest y on.
    pub rgb: Vec<u8>,
    pub width: usize,
    pub height: usize,
    low: DVec2,
    /// Pixels of a metre.
    scale: f64,
}

/// Draws the highest surface at each place; `None` of a mesh without an area.
pub fn from_above(mesh: &TriangleMesh) -> Option<FromAbove> {
    let flat = |p: &DVec3| DVec2::new(p.x, p.y);
    let low = mesh.vertices.iter().map(flat).reduce(DVec2::min)?;
    let high = mesh.vertices.iter().map(flat).reduce(DVec2::max)?;
    let size = high - low;
    if !(size.min_element() > 0.0 && size.is_finite()) {
        return None;
    }
    let scale = SIDE as f64 / size.max_element();
    let pixels = (size * scale).ceil().max(DVec2::ONE);
    let (width, height) = (pixels.x as usize, pixels.y as usize);
    let mut picture = FromAbove { rgb: vec![255; 3 * width * height], width, height, low, scale };
    let mut heights = vec![f64::NEG_INFINITY; width * height];
    for t in 0..mesh.triangles.len() {
        let label = mesh.labels.get(t).map_or(0, |label| usize::from(*label));
        picture.draw(&mesh.corners(t), label_colour(label), &mut heights);
    }
    Some(picture)
}

impl FromAbove {
    /// Place in the picture \[pixels\], y down.
    pub fn place(&self, x: f64, y: f64) -> [f64; 2] {
        [(x - self.low.x) * self.scale, self.height as f64 - (y - self.low.y) * self.scale]
    }

    fn draw(&mut self, corners: &[DVec3; 3], rgb: [u8; 3], heights: &mut [f64]) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        // Walls and undersides are not seen from above.
        if normal.z <= 1e-12 * normal.length() {
            return;
        }
        let light = normal.normalize().dot(DVec3::new(-0.5, 0.4, 0.77).normalize()).clamp(0.0, 1.0);
        let p = corners.map(|c| DVec2::from(self.place(c.x, c.y)));
        let area = (p[1] - p[0]).perp_dot(p[2] - p[0]);
        let (low, high) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
        let clamped = |x: f64, most: usize| (x.max(0.0) as usize).min(most);
        for row in clamped(low.y, self.height)..clamped(high.y + 1.0, self.height) {
            for column in clamped(low.x, self.width)..clamped(high.x + 1.0, self.width) {
                let at = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let weight = |a: usize, b: usize| (p[b] - p[a]).perp_dot(at - p[a]) / area;
                let weights = [weight(1, 2), weight(2, 0), weight(0, 1)];
                let height: f64 = weights.iter().zip(corners).map(|(w, c)| w * c.z).sum();
                let pixel = row * self.width + column;
                if weights.iter().all(|w| *w >= -1e-9) && height > heights[pixel] {
                    heights[pixel] = height;
                    let lit = rgb.map(|c| (f64::from(c) * (0.35 + 0.75 * light)).min(255.0) as u8);
                    self.rgb[3 * pixel..3 * pixel + 3].copy_from_slice(&lit);
                }
            }
        }
    }

    /// The robot's way and where its feet slipped, as SVG on top of the picture.
    pub fn way(&self, contact: &Value) -> String {
        let mut text = String::new();
        let place = |point: &Value| {
            let [x, y] = [point["at"][0].as_f64()?, point["at"][1].as_f64()?];
            (x.abs() < 1e6 && y.abs() < 1e6).then(|| self.place(x, y))
        };
        let empty = vec![];
        let path = contact["path"].as_array().unwrap_or(&empty);
        let mut run = None;
        for point in path {
            let Some([x, y]) = place(point) else { continue };
            let starts = run != point["run"].as_u64();
            if starts {
                run = point["run"].as_u64();
                text += if text.is_empty() { "<path class=\"walk\" d=\"" } else { "\"/><path class=\"walk\" d=\"" };
            }
            _ = write!(text, "{}{x:.1} {y:.1}", if starts { "M" } else { "L" });
        }
        if !text.is_empty() {
            text += "\"/>";
        }
        for point in contact["slips"].as_array().unwrap_or(&empty) {
            if let Some([x, y]) = place(point) {
                _ = write!(text, "<circle class=\"slip\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2\"/>");
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use qv_core::Material;
    use serde_json::json;

    fn square(z: f64, label: u16, from: f64, mesh: &mut TriangleMesh) {
        let first = mesh.vertices.len() as u32;
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            mesh.vertices.push(DVec3::new(from + x, y, z));
        }
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.labels.extend([label; 2]);
    }

    #[test]
    fn the_highest_surface_is_seen_in_its_colour() {
        let material = |name: &str| Material { name: name.into(), friction: None };
        let mut mesh = TriangleMesh { materials: vec![material("a"), material("b")], ..Default::default() };
        square(0.2, 1, 0.0, &mut mesh);
        square(0.0, 0, 0.0, &mut mesh);
        square(0.0, 0, 1.0, &mut mesh);
        let picture = from_above(&mesh).unwrap();
        assert_eq!((picture.width, picture.height), (SIDE, SIDE / 2));
        let at = |x: f64, y: f64| {
            let [column, row] = picture.place(x, y);
            let pixel = row as usize * picture.width + column as usize;
            [picture.rgb[3 * pixel], picture.rgb[3 * pixel + 1], picture.rgb[3 * pixel + 2]]
        };
        assert!(at(0.5, 0.3)[1] > at(0.5, 0.3)[0] + 50, "green above grey: {:?}", at(0.5, 0.3));
        assert_eq!(at(1.5, 0.3)[0], at(1.5, 0.3)[1]);
    }

    #[test]
    fn ways_are_apart_by_run() {
        let mut mesh = TriangleMesh::default();
        square(0.0, 0, 0.0, &mut mesh);
        let picture = from_above(&mesh).unwrap();
        let contact = json!({"path": [{"run": 0, "at": [0.1, 0.1]}, {"run": 0, "at": [0.2, 0.1]}, {"run": 1, "at": [0.9, 0.9]}],
            "slips": [{"at": [0.5, 0.5]}]});
        let text = picture.way(&contact);
        assert_eq!((text.matches("<path").count(), text.matches("<circle").count()), (2, 1), "{text}");
        assert!(from_above(&TriangleMesh::default()).is_none());
    }
}
