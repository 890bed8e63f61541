//! A batch of views as the stages read it: single precision, with the place of each view's tiles and pixels.

use crate::constants::{GUARD, TILE};
use crate::{RasterError, Scene, View};
use glam::{Mat3, Vec3};
use qv_core::Pose;

/// A camera of a batch: intrinsics and where its tiles and pixels begin. 16 words, as the shaders declare it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Lens {
    /// Focal lengths \[px\].
    pub focal: [f32; 2],
    /// Principal point \[px\].
    pub centre: [f32; 2],
    /// Smallest x/z and y/z at which the projection is linearised.
    pub lowest: [f32; 2],
    /// Largest x/z and y/z at which the projection is linearised.
    pub highest: [f32; 2],
    /// Columns and rows of pixels.
    pub size: [u32; 2],
    /// Columns and rows of tiles.
    pub tiles: [u32; 2],
    /// Tiles of the views before this one.
    pub first_tile: u32,
    /// Pixels of the views before this one.
    pub first_pixel: u32,
    /// Fills up the 16 words.
    pub unused: [u32; 2],
}

/// A rigid transform as rows of a 3x4 matrix; all zeros when the group is absent, which puts it behind the near plane.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Motion {
    /// Rotation and translation, row by row.
    pub rows: [[f32; 4]; 3],
}

impl Motion {
    fn of(pose: Option<Pose>) -> Self {
        let Some(pose) = pose else { return Self { rows: [[0.0; 4]; 3] } };
        let m = pose.matrix();
        let row = |i: usize| {
            let r = m.row(i);
            [r.x as f32, r.y as f32, r.z as f32, pose.position[i] as f32]
        };
        Self { rows: [row(0), row(1), row(2)] }
    }

    /// The rotation.
    pub fn rotation(&self) -> Mat3 {
        let [x, y, z] = self.rows;
        Mat3::from_cols(Vec3::new(x[0], y[0], z[0]), Vec3::new(x[1], y[1], z[1]), Vec3::new(x[2], y[2], z[2]))
    }

    /// Point in the group's frame to point in the camera's \[m\].
    pub fn transform(&self, point: [f32; 3]) -> Vec3 {
        let row = |r: &[f32; 4]| r[0] * point[0] + r[1] * point[1] + r[2] * point[2] + r[3];
        Vec3::new(row(&self.rows[0]), row(&self.rows[1]), row(&self.rows[2]))
    }
}

/// A batch of views.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// The cameras, shape `[views]`.
    pub lenses: Vec<Lens>,
    /// `camera_from_group`, shape `[views, groups]`.
    pub motions: Vec<Motion>,
    /// Number of groups.
    pub groups: usize,
    /// Tiles of all views.
    pub tiles: usize,
    /// Pixels of all views.
    pub pixels: usize,
}

impl Batch {
    /// Largest number of views.
    pub const MAX_VIEWS: usize = 4096;

    /// Lays out the views one after the other.
    ///
    /// # Errors
    /// A view is off, names an environment that is not there, or there are more than [`Self::MAX_VIEWS`] or 2^32 pixels.
    pub fn new(scene: &Scene, views: &[View]) -> Result<Self, RasterError> {
        let too_large =
            |what: &str, limit: u64, found: u64| RasterError::TooLarge { what: what.to_string(), limit, found };
        if views.len() > Self::MAX_VIEWS {
            return Err(too_large("views of one batch", Self::MAX_VIEWS as u64, views.len() as u64));
        }
        let mut batch = Self { lenses: vec![], motions: vec![], groups: scene.group_count(), tiles: 0, pixels: 0 };
        for (index, view) in views.iter().enumerate() {
            view.camera.check().map_err(|source| RasterError::Input { place: format!("view {index}"), source })?;
            let environments = scene.environments.len().max(1);
            if view.environment >= environments {
                let what = format!("environment of view {index}");
                return Err(RasterError::Index { what, count: environments, found: view.environment });
            }
            let lens = lens(view, batch.tiles, batch.pixels);
            batch.tiles += (lens.tiles[0] * lens.tiles[1]) as usize;
            batch.pixels += view.camera.pixels();
            if batch.pixels > u32::MAX as usize {
                return Err(too_large("pixels of one batch", u32::MAX as u64, batch.pixels as u64));
            }
            batch.lenses.push(lens);
            let camera_from_world = view.camera.camera_from_world;
            batch.motions.push(Motion::of(Some(camera_from_world)));
            for group in scene.environments.get(view.environment).into_iter().flatten() {
                batch.motions.push(Motion::of(group.map(|world_from_group| camera_from_world * world_from_group)));
            }
        }
        Ok(batch)
    }

    /// `camera_from_group` of a view.
    pub fn motion(&self, view: usize, group: usize) -> &Motion {
        &self.motions[view * self.groups + group]
    }

    /// View of each tile, shape `[tiles]`.
    pub fn view_of_tile(&self) -> Vec<u32> {
        let mut out = Vec::with_capacity(self.tiles);
        for (view, lens) in self.lenses.iter().enumerate() {
            out.extend(std::iter::repeat_n(view as u32, (lens.tiles[0] * lens.tiles[1]) as usize));
        }
        out
    }
}

fn lens(view: &View, first_tile: usize, first_pixel: usize) -> Lens {
    let camera = &view.camera;
    let side = |size: u32, focal: f64, centre: f64| {
        let margin = GUARD * 0.5 * size as f64 / focal;
        ((-centre / focal - margin) as f32, ((size as f64 - centre) / focal + margin) as f32)
    };
    let (low_x, high_x) = side(camera.width, camera.fx, camera.cx);
    let (low_y, high_y) = side(camera.height, camera.fy, camera.cy);
    Lens {
        focal: [camera.fx as f32, camera.fy as f32],
        centre: [camera.cx as f32, camera.cy as f32],
        lowest: [low_x, low_y],
        highest: [high_x, high_y],
        size: [camera.width, camera.height],
        tiles: [camera.width.div_ceil(TILE), camera.height.div_ceil(TILE)],
        first_tile: first_tile as u32,
        first_pixel: first_pixel as u32,
        unused: [0; 2],
    }
}
