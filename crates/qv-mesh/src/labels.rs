//! A material for each face: the features of the points nearest to it, smoothed over the surface.

use crate::MeshError;
use crate::depth::DepthFrame;
use crate::error::off;
use crate::nearest::PointGrid;
use crate::topology::{Groups, sides};
use glam::DVec3;
use qv_core::{GaussianCloud, Material, TriangleMesh};
use rayon::prelude::*;

/// Points with a score for each label: centres of Gaussians, or pixels of label images.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LabelledPoints {
    /// Places \[m\], shape `[N]`.
    pub points: Vec<DVec3>,
    /// Scores, shape `[N, k]`; the largest is the label, negative ones count as 0.
    pub scores: Vec<f32>,
    /// Number of labels k.
    pub labels: usize,
}

impl LabelledPoints {
    /// None yet, for a number of labels.
    pub fn new(labels: usize) -> Self {
        Self { labels, ..Default::default() }
    }

    /// The Gaussians whose opacity is at least `opacity`, with their features as scores.
    ///
    /// # Errors
    /// The cloud is not valid or has no features.
    pub fn of_cloud(cloud: &GaussianCloud, opacity: f32) -> Result<Self, MeshError> {
        cloud.check()?;
        if cloud.feature_count == 0 {
            return Err(off("Gaussians to label with", "features", "none"));
        }
        let mut out = Self::new(cloud.feature_count);
        let least = (opacity / (1.0 - opacity)).ln();
        for i in (0..cloud.len()).filter(|i| cloud.opacity_logits[*i] >= least) {
            out.points.push(DVec3::from_array(cloud.means[i].map(f64::from)));
            out.scores.extend(cloud.features_of(i));
        }
        Ok(out)
    }

    /// Adds every `stride`-th pixel along both axes of a label image (0 none, 1 + label), where the frame has depth.
    ///
    /// # Errors
    /// The frame is not valid, the image does not fit it, or it has a label that there is not.
    pub fn add_image(
        &mut self,
        frame: &DepthFrame,
        image: &[u8],
        stride: usize,
        index: usize,
    ) -> Result<(), MeshError> {
        frame.check(index)?;
        let place = || format!("label image {index}");
        if image.len() != frame.depth.len() {
            return Err(off(place(), format!("{} pixels as its depth", frame.depth.len()), image.len()));
        }
        if let Some(bad) = image.iter().find(|label| usize::from(**label) > self.labels) {
            return Err(off(place(), format!("labels up to {}", self.labels), bad));
        }
        let camera = &frame.camera;
        let world_from_camera = camera.camera_from_world.inverse();
        for row in (stride / 2..camera.height as usize).step_by(stride.max(1)) {
            for column in (stride / 2..camera.width as usize).step_by(stride.max(1)) {
                let pixel = row * camera.width as usize + column;
                let (Some(depth), 1..) = (frame.at(pixel, f32::MAX), image[pixel]) else { continue };
                let x = (column as f64 + 0.5 - camera.cx) / camera.fx;
                let y = (row as f64 + 0.5 - camera.cy) / camera.fy;
                self.points.push(world_from_camera.transform_point(f64::from(depth) * DVec3::new(x, y, 1.0)));
                self.scores.extend((0..self.labels).map(|label| f32::from(label + 1 == usize::from(image[pixel]))));
            }
        }
        Ok(())
    }
}

/// How faces are labelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelOptions {
    /// Points that a face asks.
    pub neighbours: usize,
    /// How far they may be \[m\].
    pub radius: f64,
    /// What agreeing with all neighbours is worth against being sure of the points; 0 for no smoothing.
    pub smoothing: f64,
    /// Regions with less area take the label round them \[m²\].
    pub min_region: f64,
}

impl Default for LabelOptions {
    fn default() -> Self {
        Self { neighbours: 12, radius: 0.1, smoothing: 1.0, min_region: 0.02 }
    }
}

/// Rounds of smoothing at most.
const ROUNDS: usize = 12;

/// Labels each face and sets the materials. Faces without a point nearby take the label of the nearest face that has one, along the
/// surface. Smoothing is the Potts model by iterated conditional modes (Besag, *On the statistical analysis of dirty pictures*,
/// 1986). Returns how many faces had points.
///
/// # Errors
/// Scores do not fit the points or the materials, a point is not finite, or no face has a point nearby.
pub fn label_faces(
    mesh: &mut TriangleMesh,
    materials: &[Material],
    from: &LabelledPoints,
    options: &LabelOptions,
) -> Result<usize, MeshError> {
    if from.scores.len() != from.points.len() * from.labels {
        let expected =
            format!("{} for {} points and {} labels", from.points.len() * from.labels, from.points.len(), from.labels);
        return Err(off("scores of labels", expected, from.scores.len()));
    }
    if materials.len() != from.labels || materials.is_empty() {
        return Err(off("materials", format!("one for each of {} labels", from.labels), materials.len()));
    }
    let scores = face_scores(mesh, from, options)?;
    let known = scores.iter().filter(|s| !s.is_empty()).count();
    if known == 0 {
        let expected = format!("points within {} m of a face", options.radius);
        return Err(off("labels", expected, format!("none of {}", from.points.len())));
    }
    let beside = beside(mesh);
    let mut labels = first_labels(&scores, &beside);
    smooth(&mut labels, &scores, &beside, from.labels, options.smoothing);
    absorb_small(&mut labels, mesh, &beside, options.min_region);
    mesh.labels = labels;
    mesh.materials = materials.to_vec();
    Ok(known)
}

/// Share of each label among a face's nearest points, nearer ones counting more; empty for a face without.
fn face_scores(mesh: &TriangleMesh, from: &LabelledPoints, options: &LabelOptions) -> Result<Vec<Vec<f32>>, MeshError> {
    let grid = PointGrid::new(&from.points, (0.125 * options.radius).max(1e-6))?;
    Ok((0..mesh.triangles.len())
        .into_par_iter()
        .map_init(Vec::new, |nearest, t| {
            let middle = mesh.corners(t).iter().sum::<DVec3>() / 3.0;
            grid.k_nearest(middle, options.neighbours, options.radius, nearest);
            let mut sums = vec![0.0f32; from.labels];
            for (index, distance) in nearest.iter() {
                let weight = (1.0 / (0.1 * options.radius + distance)) as f32;
                let scores = &from.scores[index * from.labels..(index + 1) * from.labels];
                let total: f32 = scores.iter().map(|s| s.max(0.0)).sum();
                if total > 0.0 && total.is_finite() {
                    sums.iter_mut().zip(scores).for_each(|(sum, s)| *sum += weight * s.max(0.0) / total);
                }
            }
            let total: f32 = sums.iter().sum();
            if total > 0.0 { sums.into_iter().map(|s| s / total).collect() } else { Vec::new() }
        })
        .collect())
}

/// Faces beside each face, and the length of the edge between \[m\].
fn beside(mesh: &TriangleMesh) -> Vec<Vec<(u32, f64)>> {
    let mut out = vec![Vec::with_capacity(3); mesh.triangles.len()];
    for edge in sides(mesh).chunk_by(|a, b| a.ends == b.ends).filter(|edge| edge.len() == 2) {
        let [a, b] = edge[0].ends.map(|v| mesh.vertices[v as usize]);
        let length = a.distance(b);
        out[edge[0].triangle as usize].push((edge[1].triangle, length));
        out[edge[1].triangle as usize].push((edge[0].triangle, length));
    }
    out
}

/// The strongest label of each face, spread from face to face to those that have none.
fn first_labels(scores: &[Vec<f32>], beside: &[Vec<(u32, f64)>]) -> Vec<u16> {
    let strongest = |s: &Vec<f32>| (0..s.len()).rev().max_by(|a, b| s[*a].total_cmp(&s[*b])).map(|label| label as u16);
    let mut labels: Vec<Option<u16>> = scores.iter().map(strongest).collect();
    let mut front: Vec<u32> = (0..labels.len() as u32).filter(|t| labels[*t as usize].is_some()).collect();
    while !front.is_empty() {
        let mut next = Vec::new();
        for t in front {
            for (other, _) in &beside[t as usize] {
                if labels[*other as usize].is_none() {
                    labels[*other as usize] = labels[t as usize];
                    next.push(*other);
                }
            }
        }
        front = next;
    }
    // Pieces without any point.
    labels.into_iter().map(|label| label.unwrap_or(0)).collect()
}

fn smooth(labels: &mut [u16], scores: &[Vec<f32>], beside: &[Vec<(u32, f64)>], count: usize, strength: f64) {
    let mut sums = vec![0.0f64; count];
    for _ in 0..ROUNDS {
        let mut changed = 0;
        for t in 0..labels.len() {
            let round: f64 = beside[t].iter().map(|(_, length)| length).sum();
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum = scores[t].get(k).map_or(0.0, |s| f64::from(*s));
            }
            for (other, length) in &beside[t] {
                sums[labels[*other as usize] as usize] += strength * length / round.max(1e-300);
            }
            let own = labels[t];
            let best = (0..count).fold(own as usize, |best, k| if sums[k] > sums[best] { k } else { best });
            if best != own as usize {
                labels[t] = best as u16;
                changed += 1;
            }
        }
        if changed == 0 {
            break;
        }
    }
}

/// Gives regions smaller than `least` \[m²\] the label that they border on most.
fn absorb_small(labels: &mut [u16], mesh: &TriangleMesh, beside: &[Vec<(u32, f64)>], least: f64) {
    let mut groups = Groups::new(labels.len());
    for t in 0..labels.len() {
        for (other, _) in &beside[t] {
            if labels[t] == labels[*other as usize] {
                groups.join(t as u32, *other);
            }
        }
    }
    let region: Vec<u32> = (0..labels.len() as u32).map(|t| groups.find(t)).collect();
    let mut area = vec![0.0f64; labels.len()];
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); labels.len()];
    for t in 0..labels.len() {
        let [a, b, c] = mesh.corners(t);
        area[region[t] as usize] += 0.5 * (b - a).cross(c - a).length();
        members[region[t] as usize].push(t as u32);
    }
    let mut small: Vec<usize> = (0..labels.len()).filter(|r| !members[*r].is_empty() && area[*r] < least).collect();
    small.sort_by(|a, b| area[*a].total_cmp(&area[*b]).then(a.cmp(b)));
    for r in small {
        let mut border: Vec<(u16, f64)> = Vec::new();
        for (other, length) in members[r].iter().flat_map(|t| &beside[*t as usize]) {
            let label = labels[*other as usize];
            if region[*other as usize] == r as u32 {
                continue;
            }
            match border.iter_mut().find(|b| b.0 == label) {
                Some(b) => b.1 += length,
                None => border.push((label, *length)),
            }
        }
        let longest = border.into_iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        if let Some((label, _)) = longest {
            members[r].iter().for_each(|t| labels[*t as usize] = label);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;
    use qv_core::{Camera, Pose};

    fn materials() -> Vec<Material> {
        ["grass", "stone"].map(|name| Material { name: name.into(), friction: Some(0.5) }).into()
    }

    /// 2 x 1 m in cells of 5 cm.
    fn ground() -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for j in 0..=20 {
            for i in 0..=40 {
                mesh.vertices.push(DVec3::new(0.05 * f64::from(i), 0.05 * f64::from(j), 0.0));
            }
        }
        for j in 0..20u32 {
            for i in 0..40u32 {
                let v = j * 41 + i;
                mesh.triangles.extend([[v, v + 1, v + 42], [v, v + 42, v + 41]]);
            }
        }
        mesh
    }

    /// Points whose label is grass left of x = 1, every seventh one wrong.
    fn points() -> LabelledPoints {
        let mut out = LabelledPoints::new(2);
        for i in 0..4000 {
            let p = DVec3::new(f64::from(i * 13 % 400) * 0.005, f64::from(i * 7 % 199) * 0.005, 0.01);
            let grass = (p.x < 1.0) != (i % 7 == 0);
            out.points.push(p);
            out.scores.extend(if grass { [0.9, 0.1] } else { [0.2, 0.8] });
        }
        out
    }

    fn right(mesh: &TriangleMesh) -> f64 {
        let good = (0..mesh.triangles.len()).filter(|t| {
            let middle = mesh.corners(*t).iter().sum::<DVec3>() / 3.0;
            (mesh.labels[*t] == 0) == (middle.x < 1.0)
        });
        good.count() as f64 / mesh.triangles.len() as f64
    }

    #[test]
    fn wrong_points_are_outvoted_and_regions_are_whole() {
        let mut mesh = ground();
        let known = label_faces(&mut mesh, &materials(), &points(), &LabelOptions::default()).unwrap();
        assert_eq!(known, mesh.triangles.len());
        assert!(right(&mesh) > 0.99, "{}", right(&mesh));
        let mut rough = ground();
        let plain = LabelOptions { smoothing: 0.0, neighbours: 1, min_region: 0.0, ..Default::default() };
        label_faces(&mut rough, &materials(), &points(), &plain).unwrap();
        assert!(right(&rough) < 0.95, "{}", right(&rough));
    }

    #[test]
    fn faces_without_points_take_the_label_beside_them() {
        let mut few = points();
        let keep: Vec<usize> =
            (0..few.points.len()).filter(|i| few.points[*i].x < 0.7 || few.points[*i].x > 1.6).collect();
        few.scores = keep.iter().flat_map(|i| few.scores[2 * i..2 * i + 2].to_vec()).collect();
        few.points = keep.iter().map(|i| few.points[*i]).collect();
        let mut mesh = ground();
        let known =
            label_faces(&mut mesh, &materials(), &few, &LabelOptions { radius: 0.05, ..Default::default() }).unwrap();
        assert!(known < mesh.triangles.len() && right(&mesh) > 0.85, "{known} {}", right(&mesh));
    }

    #[test]
    fn label_images_become_points() {
        let camera =
            Camera { fx: 20.0, fy: 20.0, cx: 2.0, cy: 1.0, width: 4, height: 2, camera_from_world: Pose::IDENTITY };
        let frame = DepthFrame { camera, depth: vec![2.0, 0.0, 2.0, 2.0, 2.0, 2.0, 2.0, f32::NAN], weight: vec![] };
        let mut points = LabelledPoints::new(2);
        points.add_image(&frame, &[1, 1, 0, 2, 1, 1, 2, 2], 1, 0).unwrap();
        assert_eq!((points.points.len(), points.scores[..4].to_vec()), (5, vec![1.0, 0.0, 0.0, 1.0]));
        assert!((points.points[0] - DVec3::new(-0.15, -0.05, 2.0)).length() < 1e-9);
        assert!(points.add_image(&frame, &[3; 8], 1, 4).unwrap_err().to_string().states("labels 4 2"));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let mut mesh = ground();
        let far = LabelledPoints { points: vec![DVec3::splat(50.0)], scores: vec![1.0, 0.0], labels: 2 };
        let fault = label_faces(&mut mesh, &materials(), &far, &LabelOptions::default()).unwrap_err().to_string();
        assert!(fault.states("points 0.1"), "{fault}");
        let short = LabelledPoints { scores: vec![1.0], ..far };
        assert!(label_faces(&mut mesh, &materials(), &short, &LabelOptions::default()).is_err());
        assert!(label_faces(&mut mesh, &materials()[..1], &points(), &LabelOptions::default()).is_err());
    }
}
