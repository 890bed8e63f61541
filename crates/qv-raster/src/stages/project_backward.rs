//! Derivatives of the projection: from those of the entries to those of Gaussians and poses.

use super::blend::Source;
use super::blend_backward::SHAPE_GRADIENTS;
use super::cull::logistic;
use super::project::{Shape, colour};
use crate::harmonics::{basis, basis_gradient};
use crate::lens::{Lens, Motion};
use crate::scene::Gradients;
use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;

/// Derivatives of one record.
struct RecordGradient {
    view: usize,
    splat: usize,
    mean: Vec3,
    log_scales: Vec3,
    rotation: [f32; 4],
    opacity_logit: f32,
    /// With respect to the colour, 0 where it is cut off.
    colour: Vec3,
    basis: [f32; 16],
    features: [f32; qv_core::GaussianCloud::MAX_FEATURES],
    /// Translation.
    shift: Vec3,
    /// Rotation.
    turn: Vec3,
}

/// Records whose derivatives are held at once.
const BLOCK: usize = 65_536;

/// Sums the entries' derivatives, shape `[entries, 6 + channels]`, in the order of views, Gaussians and entries.
pub fn project_backward(source: &Source, entry_gradients: &[f32]) -> Gradients {
    let mut out = Gradients::zeros(source.scene.cloud, source.batch.lenses.len());
    let mut poses = vec![[0.0f64; 6]; source.batch.lenses.len()];
    let records = source.projections.records.len();
    for start in (0..records).step_by(BLOCK) {
        let block: Vec<RecordGradient> = (start..(start + BLOCK).min(records))
            .into_par_iter()
            .filter(|&record| source.projections.counts[record] > 0)
            .filter_map(|record| record_backward(source, record, &sum_entries(source, entry_gradients, record)))
            .collect();
        for gradient in &block {
            add(source, gradient, &mut out);
            let pose = &mut poses[gradient.view];
            for axis in 0..3 {
                pose[axis] += gradient.shift[axis] as f64;
                pose[3 + axis] += gradient.turn[axis] as f64;
            }
        }
    }
    out.poses = poses.iter().map(|pose| pose.map(|x| x as f32)).collect();
    out
}

fn sum_entries(source: &Source, entry_gradients: &[f32], record: usize) -> Vec<f32> {
    let width = SHAPE_GRADIENTS + source.channels.count();
    let first = source.entries.first[record] as usize;
    let mut sum = vec![0.0; width];
    for entry in first..first + source.projections.counts[record] as usize {
        for (sum, part) in sum.iter_mut().zip(&entry_gradients[entry * width..(entry + 1) * width]) {
            *sum += part;
        }
    }
    sum
}

fn add(source: &Source, from: &RecordGradient, out: &mut Gradients) {
    let splat = from.splat;
    for axis in 0..3 {
        out.means[splat][axis] += from.mean[axis];
        out.log_scales[splat][axis] += from.log_scales[axis];
    }
    for k in 0..4 {
        out.rotations[splat][k] += from.rotation[k];
    }
    out.opacity_logits[splat] += from.opacity_logit;
    let count = source.scene.cloud.sh_count();
    for (value, sh) in from.basis.iter().zip(&mut out.sh[splat * count..(splat + 1) * count]) {
        for c in 0..3 {
            sh[c] += value * from.colour[c];
        }
    }
    let features = source.channels.features().len();
    for (k, feature) in from.features[..features].iter().enumerate() {
        out.features[splat * features + k] += feature;
    }
}

fn record_backward(source: &Source, record: usize, sum: &[f32]) -> Option<RecordGradient> {
    let scene = source.scene;
    let projected = &source.projections.records[record];
    let (view, splat) = (projected.view as usize, projected.splat as usize);
    let (lens, motion) = (&source.batch.lenses[view], source.batch.motion(view, scene.group(splat)));
    let shape = Shape::new(scene, splat, lens, motion, source.settings)?;
    let rotation = motion.rotation();

    let mut centre = mean_backward(&shape, lens, [sum[0], sum[1]]);
    let opacity = logistic(scene.cloud.opacity_logits[splat]);
    // What is left of the opacity depends on the shape where the low-pass is made up for.
    let by_kept = if source.settings.antialias { sum[5] * opacity } else { 0.0 };
    let (spread, log_scales, by_centre) = covariance_backward(&shape, lens, [sum[2], sum[3], sum[4]], by_kept);
    centre += by_centre;
    let by_channel = &sum[SHAPE_GRADIENTS..];
    if let Some(depth) = source.channels.depth() {
        centre.z += by_channel[depth];
    }
    let mut turn = Vec3::ZERO;
    let mut by_axes = Mat3::ZERO;
    if let Some(plane) = source.channels.plane() {
        // The distance is -normal . centre.
        let (normal, sign) = shape.normal();
        let by_distance = by_channel[plane + 3];
        centre -= normal * by_distance;
        let by_normal = Vec3::from_slice(&by_channel[plane..]) - shape.centre * by_distance;
        turn += normal.cross(by_normal);
        *by_axes.col_mut(shape.shortest) = rotation.transpose() * (by_normal * sign);
    }
    turn += shape.centre.cross(centre);
    for k in 0..3 {
        turn += shape.spread.col(k).cross(spread.col(k));
    }
    let in_group = rotation.transpose() * spread;
    for k in 0..3 {
        *by_axes.col_mut(k) += shape.scales[k] * in_group.col(k);
    }
    let (by_colour, values, by_offset) = colour_backward(source, splat, &shape, motion, by_channel);
    let mut features = [0.0; qv_core::GaussianCloud::MAX_FEATURES];
    let range = source.channels.features();
    features[..range.len()].copy_from_slice(&by_channel[range]);
    Some(RecordGradient {
        view,
        splat,
        mean: rotation.transpose() * centre + by_offset,
        log_scales,
        rotation: quaternion_backward(scene.cloud.rotations[splat], shape.length, &by_axes),
        opacity_logit: sum[5] * shape.kept * opacity * (1.0 - opacity),
        colour: by_colour,
        basis: values,
        features,
        // A turn of the camera about its own centre does not change the direction in which a Gaussian is seen.
        shift: centre + rotation * by_offset,
        turn,
    })
}

/// With respect to the centre in camera axes, through the projected mean.
fn mean_backward(shape: &Shape, lens: &Lens, by_mean: [f32; 2]) -> Vec3 {
    let (p, [fx, fy]) = (shape.centre, lens.focal);
    let (u, v) = (fx / p.z * by_mean[0], fy / p.z * by_mean[1]);
    Vec3::new(u, v, -(u * p.x + v * p.y) / p.z)
}

/// With respect to W, to the log scales, and to the centre in camera axes, through the covariance C. `whitened` are the sums of
/// G e eᵀ/2 with e = U δ, the mixed one of both places. With M their matrix the derivative by C is -Uᵀ M U, by the rows R of J W
/// -2 Uᵀ M V with V = U R, and by log scale k -2 V_k·M V_k, in which nothing large cancels. `by_kept` is the derivative by the share of the
/// opacity that is kept.
fn covariance_backward(shape: &Shape, lens: &Lens, whitened: [f32; 3], by_kept: f32) -> (Mat3, Vec3, Vec3) {
    let [u00, u01, u11] = shape.factor();
    let [row_x, row_y] = shape.rows;
    let v = [u00 * row_x + u01 * row_y, u11 * row_y];
    let [xx, xy, yy] = [-2.0 * whitened[0], -whitened[1], -2.0 * whitened[2]];
    let by_v = [xx * v[0] + xy * v[1], xy * v[0] + yy * v[1]];
    let mut log_scales = v[0] * by_v[0] + v[1] * by_v[1];
    let mut by_rows = [u00 * by_v[0], u01 * by_v[0] + u11 * by_v[1]];
    if by_kept != 0.0 {
        for (axis, by) in shape.by_rows_of_kept().into_iter().enumerate() {
            by_rows[axis] += by_kept * by;
            log_scales += by_kept * by * shape.rows[axis];
        }
    }

    let z = shape.centre.z;
    let along = shape.spread.transpose().z_axis;
    let mut by_spread = [Vec3::ZERO; 3];
    let mut centre = Vec3::new(0.0, 0.0, -log_scales.element_sum() / z);
    for axis in 0..2 {
        let scale = lens.focal[axis] / z;
        by_spread[axis] = scale * by_rows[axis];
        by_spread[2] -= scale * shape.slope[axis] * by_rows[axis];
        let by_slope = -scale * along.dot(by_rows[axis]);
        let ratio = shape.centre[axis] / z;
        if ratio == shape.slope[axis] {
            centre[axis] += by_slope / z;
            centre.z -= by_slope * ratio / z;
        }
    }
    (Mat3::from_cols(by_spread[0], by_spread[1], by_spread[2]).transpose(), log_scales, centre)
}

/// With respect to the colour where it is not cut off, the functions' values, and what comes to the offset of the mean from
/// the camera, in the group's axes.
fn colour_backward(
    source: &Source,
    splat: usize,
    shape: &Shape,
    motion: &Motion,
    by_channel: &[f32],
) -> (Vec3, [f32; 16], Vec3) {
    let scene = source.scene;
    let (direction, distance) = shape.direction(motion);
    let before = colour(scene, splat, direction);
    let mut by_colour = Vec3::from_slice(by_channel);
    for c in 0..3 {
        if before[c] <= 0.0 {
            by_colour[c] = 0.0;
        }
    }
    let degree = scene.cloud.sh_degree;
    let mut by_direction = Vec3::ZERO;
    for (gradient, sh) in basis_gradient(degree, direction).iter().zip(scene.cloud.sh_of(splat)) {
        by_direction += *gradient * by_colour.dot(Vec3::from_array(*sh));
    }
    let by_offset = (by_direction - direction * direction.dot(by_direction)) / distance;
    (by_colour, basis(degree, direction), by_offset)
}

/// From the derivative with respect to the rotation matrix to that of the quaternion w, x, y, z before it is normalised.
fn quaternion_backward(wxyz: [f32; 4], length: f32, by_axes: &Mat3) -> [f32; 4] {
    let [w, x, y, z] = wxyz.map(|k| k / length);
    let d = |row: usize, column: usize| by_axes.col(column)[row];
    let by = [
        x * (d(2, 1) - d(1, 2)) + y * (d(0, 2) - d(2, 0)) + z * (d(1, 0) - d(0, 1)),
        y * (d(0, 1) + d(1, 0)) + z * (d(0, 2) + d(2, 0)) + w * (d(2, 1) - d(1, 2)) - 2.0 * x * (d(1, 1) + d(2, 2)),
        x * (d(0, 1) + d(1, 0)) + z * (d(1, 2) + d(2, 1)) + w * (d(0, 2) - d(2, 0)) - 2.0 * y * (d(0, 0) + d(2, 2)),
        x * (d(0, 2) + d(2, 0)) + y * (d(1, 2) + d(2, 1)) + w * (d(1, 0) - d(0, 1)) - 2.0 * z * (d(0, 0) + d(1, 1)),
    ];
    let by = Quat::from_xyzw(by[1], by[2], by[3], by[0]) * 2.0;
    let unit = Quat::from_xyzw(x, y, z, w);
    let across = (by - unit * unit.dot(by)) * (1.0 / length);
    [across.w, across.x, across.y, across.z]
}
