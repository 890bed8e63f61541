//! Projection of the candidates: mean, inverse covariance, opacity, depth, colour, plane, and the number of tiles touched.

use super::cull::{Candidate, logistic};
use crate::constants::{MIN_ALPHA, MIN_QUATERNION};
use crate::ellipse::Ellipse;
use crate::harmonics::basis;
use crate::lens::{Batch, Lens, Motion};
use crate::{Scene, Settings};
use glam::{Mat3, Quat, Vec2, Vec3};
use rayon::prelude::*;

/// A Gaussian as a view sees it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ProjectedGaussian {
    /// Projected mean \[px\].
    pub mean: [f32; 2],
    /// `u00, u01, u11` of the upper triangle U with `UᵀU` the inverse of the 2D covariance \[1/px\].
    pub factor: [f32; 3],
    /// Opacity at the mean; with [`Settings::antialias`] what is left of it.
    pub opacity: f32,
    /// Depth of the mean along z of the camera \[m\].
    pub depth: f32,
    /// Index of the view.
    pub view: u32,
    /// Colour in the direction of the view.
    pub colour: [f32; 3],
    /// Index of the Gaussian.
    pub splat: u32,
}

/// The plane of a Gaussian: through its mean, across its shortest axis.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Plane {
    /// Unit normal towards the camera, in camera axes.
    pub normal: [f32; 3],
    /// Distance of the plane from the camera's centre \[m\].
    pub distance: f32,
}

/// What this stage gives.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Projections {
    /// One for each candidate; meaningless where `counts` is 0.
    pub records: Vec<ProjectedGaussian>,
    /// One for each candidate when asked for, or none.
    pub planes: Vec<Plane>,
    /// Tiles that each candidate touches.
    pub counts: Vec<u32>,
    /// Candidates that were left out because a number is not finite or a quaternion has no direction.
    pub faulty: usize,
}

/// Projects all candidates.
pub fn project(scene: &Scene, batch: &Batch, candidates: &[Candidate], settings: &Settings) -> Projections {
    let outputs = settings.outputs;
    let mut out = Projections {
        records: vec![ProjectedGaussian::default(); candidates.len()],
        planes: vec![Plane::default(); if outputs.plane { candidates.len() } else { 0 }],
        counts: vec![0; candidates.len()],
        faulty: 0,
    };
    let one = |candidate: &Candidate, record: &mut ProjectedGaussian, count: &mut u32| -> (usize, Option<Plane>) {
        let Some((projected, plane, tiles)) = project_one(scene, batch, *candidate, settings) else {
            return (1, None);
        };
        (*record, *count) = (projected, tiles);
        (0, Some(plane))
    };
    let lists = (candidates, &mut out.records, &mut out.counts);
    out.faulty = if outputs.plane {
        let with_plane = (lists, &mut out.planes).into_par_iter();
        with_plane
            .map(|((candidate, record, count), slot)| {
                let (faulty, plane) = one(candidate, record, count);
                *slot = plane.unwrap_or_default();
                faulty
            })
            .sum()
    } else {
        lists.into_par_iter().map(|(candidate, record, count)| one(candidate, record, count).0).sum()
    };
    out
}

fn project_one(
    scene: &Scene,
    batch: &Batch,
    candidate: Candidate,
    settings: &Settings,
) -> Option<(ProjectedGaussian, Plane, u32)> {
    let (view, splat) = (candidate.view as usize, candidate.splat as usize);
    let lens = &batch.lenses[view];
    let motion = batch.motion(view, scene.group(splat));
    let shape = Shape::new(scene, splat, lens, motion, settings)?;
    let opacity = shape.kept * logistic(scene.cloud.opacity_logits[splat]);
    let colour = colour(scene, splat, shape.direction(motion).0);
    let record = ProjectedGaussian {
        mean: shape.mean(lens).into(),
        factor: shape.factor(),
        opacity,
        depth: shape.centre.z,
        view: candidate.view,
        colour: colour.max(Vec3::ZERO).into(),
        splat: candidate.splat,
    };
    let (normal, _) = shape.normal();
    let plane = Plane { normal: normal.into(), distance: -normal.dot(shape.centre) };
    // Sums catch every number that is not finite: none cancels another into a finite one.
    let colour = colour.as_ref();
    let features = if settings.outputs.features { scene.cloud.features_of(splat) } else { &[] };
    let all = record.mean.iter().chain(&record.factor).chain(colour).chain(features);
    // A direction cannot be reported for a centre whose square overflows.
    let sum = all.map(|x| x.abs()).sum::<f32>() + record.opacity + shape.centre.length_squared();
    if !sum.is_finite() || record.factor[0] <= 0.0 || record.factor[2] <= 0.0 {
        return None;
    }
    let count = if opacity < MIN_ALPHA { 0 } else { Ellipse::new(record.mean, record.factor, opacity).count(lens) };
    Some((record, plane, count))
}

/// Colour before it is cut off at 0, in a unit direction of the Gaussian's group.
pub(crate) fn colour(scene: &Scene, splat: usize, direction: Vec3) -> Vec3 {
    let values = basis(scene.cloud.sh_degree, direction);
    let mut sum = Vec3::splat(0.5);
    for (value, coefficient) in values.iter().zip(scene.cloud.sh_of(splat)) {
        sum += *value * Vec3::from_array(*coefficient);
    }
    sum
}

/// A Gaussian in a camera's axes with its projection (Zwicker et al., *EWA Splatting*, 2002): the 2D covariance is
/// `J W WᵀJᵀ` plus the low-pass, with W = `camera_from_group` R(q) diag(s) and J the derivative of the projection.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    /// Mean in camera axes \[m\].
    pub centre: Vec3,
    /// R(q), from the Gaussian's axes to its group's.
    pub axes: Mat3,
    /// Length of the quaternion before it was normalised.
    pub length: f32,
    /// Standard deviations \[m\].
    pub scales: Vec3,
    /// W.
    pub spread: Mat3,
    /// Rotation of `camera_from_group`.
    pub rotation: Mat3,
    /// x/z and y/z, kept near the image.
    pub slope: Vec2,
    /// Rows of J W.
    pub rows: [Vec3; 2],
    /// Variances and covariance in the image \[px²\]: xx, xy, yy.
    pub covariance: [f32; 3],
    /// Determinant of the 2D covariance.
    pub determinant: f32,
    /// What was added to the variances \[px²\].
    pub low_pass: f32,
    /// Cross product of the rows; its square is the determinant before the low-pass.
    pub area: Vec3,
    /// Share of the opacity that is kept: the root of the determinant's quotient with [`Settings::antialias`], else 1.
    pub kept: f32,
    /// Index of the shortest axis.
    pub shortest: usize,
}

impl Shape {
    /// `None` when the quaternion has no direction.
    pub fn new(scene: &Scene, splat: usize, lens: &Lens, motion: &Motion, settings: &Settings) -> Option<Self> {
        let [w, x, y, z] = scene.cloud.rotations[splat];
        let square = w * w + x * x + y * y + z * z;
        // Written so that NaN is refused, too.
        if !(square >= MIN_QUATERNION && square.is_finite()) {
            return None;
        }
        let length = square.sqrt();
        let axes = Mat3::from_quat(Quat::from_xyzw(x / length, y / length, z / length, w / length));
        let log_scales = Vec3::from_array(scene.cloud.log_scales[splat]);
        let scales = Vec3::new(log_scales.x.exp(), log_scales.y.exp(), log_scales.z.exp());
        let rotation = motion.rotation();
        let spread = rotation * Mat3::from_cols(axes.x_axis * scales.x, axes.y_axis * scales.y, axes.z_axis * scales.z);
        let centre = motion.transform(scene.cloud.means[splat]);
        let slope = Vec2::new(
            (centre.x / centre.z).clamp(lens.lowest[0], lens.highest[0]),
            (centre.y / centre.z).clamp(lens.lowest[1], lens.highest[1]),
        );
        let of_row = spread.transpose();
        let row = |axis: usize| (lens.focal[axis] / centre.z) * (of_row.col(axis) - slope[axis] * of_row.z_axis);
        let rows = [row(0), row(1)];
        let (xx, yy) = (rows[0].length_squared(), rows[1].length_squared());
        // Lagrange's identity instead of xx yy - xy²: nothing cancels when the Gaussian is seen edge on.
        let (low_pass, area) = (settings.low_pass(), rows[0].cross(rows[1]));
        let determinant = area.length_squared() + low_pass * (xx + yy) + low_pass * low_pass;
        let covariance = [xx + low_pass, rows[0].dot(rows[1]), yy + low_pass];
        let kept = if settings.antialias { area.length() / determinant.sqrt() } else { 1.0 };
        let shortest = match scales {
            s if s.x <= s.y && s.x <= s.z => 0,
            s if s.y <= s.z => 1,
            _ => 2,
        };
        Some(Self {
            centre,
            axes,
            length,
            scales,
            spread,
            rotation,
            slope,
            rows,
            covariance,
            determinant,
            low_pass,
            area,
            kept,
            shortest,
        })
    }

    fn mean(&self, lens: &Lens) -> Vec2 {
        Vec2::new(
            lens.focal[0] * (self.centre.x / self.centre.z) + lens.centre[0],
            lens.focal[1] * (self.centre.y / self.centre.z) + lens.centre[1],
        )
    }

    /// `u00, u01, u11` of the inverse covariance `UᵀU`.
    pub fn factor(&self) -> [f32; 3] {
        let [_, xy, yy] = self.covariance;
        let u00 = (yy / self.determinant).sqrt();
        [u00, -(xy / yy) * u00, 1.0 / yy.sqrt()]
    }

    /// Derivatives of the share of the opacity that is kept by the rows, zeros where that is none: with a = r_x x r_y, D the determinant and k
    /// the share, (r_y x a/|a|) / √D - k (r_y x a + l r_x) / D by the first, as much by the other with a x r_x.
    pub fn by_rows_of_kept(&self) -> [Vec3; 2] {
        let unit = self.area.normalize_or_zero();
        let of = |own: Vec3, turned: &dyn Fn(Vec3) -> Vec3| {
            turned(unit) / self.determinant.sqrt()
                - self.kept / self.determinant * (turned(self.area) + self.low_pass * own)
        };
        let [x, y] = self.rows;
        [of(x, &|a| y.cross(a)), of(y, &|a| a.cross(x))]
    }

    /// Unit direction from the camera to the mean in the group's axes, and the distance \[m\].
    pub fn direction(&self, motion: &Motion) -> (Vec3, f32) {
        let distance = self.centre.length();
        (motion.rotation().transpose() * (self.centre / distance), distance)
    }

    /// Unit normal towards the camera in camera axes, and the sign that turned the shortest axis there.
    pub fn normal(&self) -> (Vec3, f32) {
        let normal = self.rotation * self.axes.col(self.shortest);
        let sign = if normal.dot(self.centre) > 0.0 { -1.0 } else { 1.0 };
        (normal * sign, sign)
    }
}
