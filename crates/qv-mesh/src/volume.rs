//! A truncated signed distance in blocks of voxels where there is surface, and nowhere else (Curless and Levoy, *A volumetric
//! method for building complex models from range images*, 1996; blocks found by hashing as Nießner et al., *Real-time 3D
//! reconstruction at scale using voxel hashing*, 2013).

use crate::MeshError;
use crate::depth::{DepthFrame, PixelPlane, planes};
use crate::error::off;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Voxels along each side of a block.
pub(crate) const SIDE: usize = 8;
/// Voxels of a block.
pub(crate) const VOXELS: usize = SIDE * SIDE * SIDE;
/// Weight of an observation that is trusted fully, in units of a voxel's weight.
const FULL: f32 = 256.0;
/// A voxel far behind what a camera sees along the ray is not reported by it, however close it is to the plane, in truncations.
const BEHIND: f32 = 3.0;
/// Memory of a block beside its voxels: pointer, key and entry of the table, bytes.
const BLOCK_OVERHEAD: u64 = 64;
/// Bits of a block's coordinate.
const BITS: i64 = 21;

/// How depth is fused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FuseOptions {
    /// Side of a voxel \[m\].
    pub voxel: f64,
    /// Distance at which the signed distance is cut off, in voxels; 3 to 5 is usual.
    pub truncation: f64,
    /// Depths beyond are left out \[m\].
    pub max_depth: f64,
    /// Weight from which on a voxel counts as seen; 1 is one view from straight ahead within a metre.
    pub min_weight: f64,
    /// Most memory for voxels, bytes.
    pub memory_limit: u64,
}

impl Default for FuseOptions {
    fn default() -> Self {
        Self { voxel: 0.02, truncation: 4.0, max_depth: 8.0, min_weight: 0.03, memory_limit: 8 << 30 }
    }
}

/// Signed distance in units of the truncation (32767 is 1), positive on the cameras' side, and how sure it is. Four bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Voxel {
    pub distance: i16,
    pub weight: u16,
}

/// Block coordinates, packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct BlockKey(u64);

impl BlockKey {
    /// None when a coordinate is out of range.
    pub fn of(block: [i64; 3]) -> Option<Self> {
        let half = 1i64 << (BITS - 1);
        let fits = block.iter().all(|c| (-half..half).contains(c));
        fits.then(|| Self(block.iter().rev().fold(0u64, |key, c| key << BITS | (c + half) as u64)))
    }

    pub fn coordinates(self) -> [i64; 3] {
        let half = 1i64 << (BITS - 1);
        std::array::from_fn(|k| (self.0 >> (BITS * k as i64) & ((1 << BITS) - 1)) as i64 - half)
    }
}

/// Spreads packed keys over the table; no random state, so that runs are alike.
#[derive(Debug, Default)]
pub(crate) struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(u64::from(*byte)));
    }

    fn write_u64(&mut self, value: u64) {
        let x = (self.0 ^ value).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        self.0 = (x ^ (x >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb) ^ (x >> 32);
    }
}

pub(crate) type KeyMap<K, V> = HashMap<K, V, BuildHasherDefault<KeyHasher>>;

/// The signed distance to what depth maps show. First [`Volume::allocate`] every frame, then [`Volume::integrate`] every frame.
#[derive(Debug)]
pub struct Volume {
    options: FuseOptions,
    pub(crate) index: KeyMap<BlockKey, u32>,
    pub(crate) keys: Vec<BlockKey>,
    /// Boxed: a growing vector would copy all voxels and take twice their memory for a while.
    #[allow(clippy::vec_box)]
    pub(crate) blocks: Vec<Box<[Voxel; VOXELS]>>,
}

impl Volume {
    /// An empty volume.
    ///
    /// # Errors
    /// An option is out of range.
    pub fn new(options: &FuseOptions) -> Result<Self, MeshError> {
        for (what, found, least, most) in [
            ("voxel", options.voxel, 1e-4, 10.0),
            ("truncation", options.truncation, 1.5, SIDE as f64),
            ("max_depth", options.max_depth, 1e-3, 1e4),
            ("min_weight", options.min_weight, 0.0, 1e3),
        ] {
            if !(least..=most).contains(&found) {
                return Err(off(format!("option {what}"), format!("{least} to {most}"), found));
            }
        }
        Ok(Self { options: *options, index: KeyMap::default(), keys: vec![], blocks: vec![] })
    }

    /// Side of a voxel \[m\].
    pub fn voxel(&self) -> f64 {
        self.options.voxel
    }

    /// Distance at which the signed distance is cut off \[m\].
    pub fn truncation(&self) -> f64 {
        self.options.truncation * self.options.voxel
    }

    /// Smallest weight of a voxel that counts as seen.
    pub(crate) fn least_weight(&self) -> u16 {
        (self.options.min_weight * f64::from(FULL)).round().clamp(1.0, 65535.0) as u16
    }

    /// Number of blocks of 8 x 8 x 8 voxels.
    pub fn block_count(&self) -> usize {
        self.blocks.len()
    }

    /// Memory for the voxels and for finding them, bytes.
    pub fn memory(&self) -> u64 {
        Self::memory_of(self.blocks.len())
    }

    fn memory_of(blocks: usize) -> u64 {
        blocks as u64 * (size_of::<[Voxel; VOXELS]>() as u64 + BLOCK_OVERHEAD)
    }

    /// Makes blocks round everything that a frame shows. Returns the number of pixels with depth.
    ///
    /// # Errors
    /// The frame is not valid, reaches too far from the origin, or needs more memory than allowed; nothing is taken then.
    pub fn allocate(&mut self, frame: &DepthFrame, index: usize) -> Result<usize, MeshError> {
        frame.check(index)?;
        let width = frame.camera.width as usize;
        let rows: Vec<Result<(usize, Vec<BlockKey>), DVec3>> =
            (0..frame.camera.height as usize).into_par_iter().map(|row| self.touched(frame, row, width)).collect();
        let (mut pixels, mut keys) = (0, Vec::new());
        for row in rows {
            let (seen, found) = row.map_err(|point| {
                let reach = (1i64 << (BITS - 1)) as f64 * SIDE as f64 * self.options.voxel;
                off(
                    format!("depth frame {index}"),
                    format!("points within {reach:.0} m of the origin"),
                    format!("{point:.1}"),
                )
            })?;
            pixels += seen;
            keys.extend(found);
        }
        keys.par_sort_unstable();
        keys.dedup();
        keys.retain(|key| !self.index.contains_key(key));
        let needed = Self::memory_of(self.blocks.len() + keys.len());
        if needed > self.options.memory_limit {
            return Err(MeshError::Memory {
                place: format!("signed distance, {} m voxels, after depth frame {index}", self.options.voxel),
                limit: self.options.memory_limit,
                needed,
                advice: "larger voxels, a smaller max_depth or a higher limit would do".into(),
            });
        }
        for key in keys {
            self.index.insert(key, self.blocks.len() as u32);
            self.keys.push(key);
            self.blocks.push(Box::new([Voxel::default(); VOXELS]));
        }
        Ok(pixels)
    }

    /// Pixels with depth in a row, and the blocks within the truncation of what they show; the first point that is too far.
    fn touched(&self, frame: &DepthFrame, row: usize, width: usize) -> Result<(usize, Vec<BlockKey>), DVec3> {
        let camera = &frame.camera;
        let world_from_camera = camera.camera_from_world.inverse();
        let (block, reach) = (self.options.voxel * SIDE as f64, self.truncation());
        let (mut seen, mut keys, mut last) = (0, Vec::new(), None);
        for column in 0..width {
            let Some(depth) = frame.at(row * width + column, self.options.max_depth as f32) else { continue };
            seen += 1;
            let x = (column as f64 + 0.5 - camera.cx) / camera.fx;
            let y = (row as f64 + 0.5 - camera.cy) / camera.fy;
            let point = world_from_camera.transform_point(f64::from(depth) * DVec3::new(x, y, 1.0));
            let (low, high) = (((point - reach) / block).floor(), ((point + reach) / block).floor());
            let range = (low.to_array().map(|c| c as i64), high.to_array().map(|c| c as i64));
            if last == Some(range) {
                continue;
            }
            last = Some(range);
            for z in range.0[2]..=range.1[2] {
                for y in range.0[1]..=range.1[1] {
                    for x in range.0[0]..=range.1[0] {
                        keys.push(BlockKey::of([x, y, z]).ok_or(point)?);
                    }
                }
            }
        }
        keys.sort_unstable();
        keys.dedup();
        Ok((seen, keys))
    }

    /// Adds what a frame says of every voxel that it sees.
    ///
    /// # Errors
    /// The frame is not valid.
    pub fn integrate(&mut self, frame: &DepthFrame, index: usize) -> Result<(), MeshError> {
        frame.check(index)?;
        let seen = PreparedFrame {
            planes: planes(frame, self.options.max_depth as f32),
            farthest: (0..frame.depth.len())
                .filter_map(|i| frame.at(i, self.options.max_depth as f32))
                .fold(0.0, f32::max),
            frame,
            voxel: self.options.voxel,
            truncation: self.truncation() as f32,
        };
        self.blocks.par_iter_mut().zip(&self.keys).for_each(|(block, key)| seen.update(block, *key));
        Ok(())
    }
}

/// A frame, prepared.
struct PreparedFrame<'a> {
    frame: &'a DepthFrame,
    planes: Vec<PixelPlane>,
    /// Greatest depth \[m\].
    farthest: f32,
    voxel: f64,
    truncation: f32,
}

impl PreparedFrame<'_> {
    /// Adds the frame to one block.
    fn update(&self, block: &mut [Voxel; VOXELS], key: BlockKey) {
        let camera = &self.frame.camera;
        let side = self.voxel * SIDE as f64;
        let corner = DVec3::from_array(key.coordinates().map(|c| c as f64 * side));
        let rotation = camera.camera_from_world.matrix();
        let first = camera.camera_from_world.transform_point(corner);
        let radius = 0.5 * 3.0f64.sqrt() * side;
        if !self.may_see(first + rotation * DVec3::splat(0.5 * side - 0.5 * self.voxel), radius) {
            return;
        }
        let step = |axis: DVec3| (rotation * axis * self.voxel).as_vec3();
        let (dx, dy, dz) = (step(DVec3::X), step(DVec3::Y), step(DVec3::Z));
        let first = first.as_vec3();
        let (focal, centre) = ([camera.fx as f32, camera.fy as f32], [camera.cx as f32, camera.cy as f32]);
        let size = [camera.width as f32, camera.height as f32];
        for (i, voxel) in block.iter_mut().enumerate() {
            let (x, y, z) = (i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE));
            let p = first + x as f32 * dx + y as f32 * dy + z as f32 * dz;
            if p.z <= 0.0 {
                continue;
            }
            let (u, v) = (focal[0] * p.x / p.z + centre[0], focal[1] * p.y / p.z + centre[1]);
            if !(u >= 0.0 && v >= 0.0 && u < size[0] && v < size[1]) {
                continue;
            }
            let plane = &self.planes[v as usize * camera.width as usize + u as usize];
            if plane.weight > 0.0 {
                self.observe(voxel, plane, p, [u - u.floor() - 0.5, v - v.floor() - 0.5]);
            }
        }
    }

    /// Whether a ball \[m, camera axes\] may be in the image and not beyond all depths.
    fn may_see(&self, centre: DVec3, radius: f64) -> bool {
        let camera = &self.frame.camera;
        if centre.z < -radius || centre.z > f64::from(self.farthest + BEHIND * self.truncation) + radius {
            return false;
        }
        // Distance outside each side plane of the pyramid of view.
        let outside =
            |along: f64, focal: f64, edge: f64| (along * focal + edge * centre.z) / focal.hypot(edge) > radius;
        !(outside(centre.x, camera.fx, camera.cx - f64::from(camera.width))
            || outside(-centre.x, camera.fx, -camera.cx)
            || outside(centre.y, camera.fy, camera.cy - f64::from(camera.height))
            || outside(-centre.y, camera.fy, -camera.cy))
    }

    /// Adds one pixel's word about one voxel: its distance to the plane that the pixel sees.
    fn observe(&self, voxel: &mut Voxel, plane: &PixelPlane, p: Vec3, off_centre: [f32; 2]) {
        let inverse = plane.inverse + plane.slope[0] * off_centre[0] + plane.slope[1] * off_centre[1];
        // 1 - z n·ray is the share of the way to the plane that is left.
        let distance = (1.0 - p.z * inverse) * plane.distance;
        let behind = (p.z - plane.inverse.recip()) * p.length() / p.z;
        if distance.is_nan() || distance < -self.truncation || behind > BEHIND * self.truncation {
            return;
        }
        let found = (distance / self.truncation).min(1.0) * 32767.0;
        let weight = (plane.weight * FULL).round().max(1.0);
        let before = f32::from(voxel.weight);
        let mean = f32::from(voxel.distance) + (found - f32::from(voxel.distance)) * (weight / (before + weight));
        voxel.distance = mean.round() as i16;
        voxel.weight = (before + weight).min(65535.0) as u16;
    }
}

/// Fuses frames.
///
/// # Errors
/// Fewer than two frames, no depth at all, or what [`Volume::allocate`] says.
pub fn fuse(frames: &[DepthFrame], options: &FuseOptions) -> Result<Volume, MeshError> {
    if frames.len() < 2 {
        return Err(off("depth frames", "two or more", frames.len()));
    }
    let mut volume = Volume::new(options)?;
    let mut pixels = 0;
    for (index, frame) in frames.iter().enumerate() {
        pixels += volume.allocate(frame, index)?;
    }
    if pixels == 0 {
        let expected = format!("depth between 0 and {} m", options.max_depth);
        return Err(off("depth frames", expected, format!("none in {} frames", frames.len())));
    }
    for (index, frame) in frames.iter().enumerate() {
        volume.integrate(frame, index)?;
    }
    Ok(volume)
}
