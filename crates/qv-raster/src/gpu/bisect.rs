//! The CPU up to some stage, the graphics card from there: to find the stage that is off.

use super::cloud::GpuCloud;
use super::images::GpuImages;
use super::rasteriser::{GpuRasteriser, GpuSettings, Stage};
use super::record::Recorder;
use super::steps::FrameSteps;
use crate::frame::Frame;
use crate::shaders::slot;
use crate::stages::sort::depth_key;
use crate::{RasterError, Scene, View};

impl GpuRasteriser {
    /// As [`Self::render`], with what `frame`, which the CPU drew of the same views, found up to and with `stage`. Derivatives
    /// cannot follow: they need what the card's own first stage leaves.
    ///
    /// # Errors
    /// As [`Self::render`]; or images are asked for in bytes, for which the card has records of its own.
    pub fn render_after(
        &mut self,
        stage: Stage,
        frame: &Frame,
        cloud: &GpuCloud,
        scene: &Scene,
        views: &[View],
        how: &GpuSettings,
    ) -> Result<GpuImages<'_>, RasterError> {
        if how.bytes {
            return Err(RasterError::Device("after the CPU's stages: expected images in floats, found bytes".into()));
        }
        self.prepare(cloud, scene, views, &frame.settings, how)?;
        self.make_room(frame.candidates.len(), frame.entries.tiles.len() + frame.entries.tiles.len() / 8)?;
        self.remake_constants(cloud, &frame.settings)?;
        let (Some(batch), Some(buffers), Some(constants)) = (&self.batch, &self.buffers, &self.constants) else {
            return Err(RasterError::Device("expected a prepared batch, found none".into()));
        };
        if frame.batch != *batch {
            return Err(RasterError::Device("expected a frame of the same views, found another".into()));
        }
        self.upload(stage, frame)?;
        let steps = FrameSteps { batch, buffers, constants, cloud };
        let mut recorder = Recorder::new(&self.gpu, false);
        recorder.run("plan", &[steps.plan("visible")]);
        if stage < Stage::Project {
            recorder.run("project", &steps.project());
        }
        if stage < Stage::SortByDepth {
            recorder.run("sort by depth", &steps.sort_by_depth());
        }
        if stage < Stage::Emit {
            recorder.run("emit", &steps.emit());
        } else {
            recorder.run("plan", &[steps.plan("entries")]);
        }
        if stage < Stage::SortByTile {
            recorder.run("sort by tile", &steps.sort_by_tile());
        }
        if stage < Stage::Ranges {
            recorder.encoder.clear_buffer(buffers.get("ranges"), 0, None);
            recorder.run("ranges", &steps.ranges());
        }
        recorder.run("blend", &steps.blend());
        recorder.submit();
        (self.after, self.drawn) = (Some(stage), true);
        self.images()
    }

    /// Puts what the stages up to `stage` found where the next ones read it.
    fn upload(&self, stage: Stage, frame: &Frame) -> Result<(), RasterError> {
        let (Some(buffers), Some(constants)) = (&self.buffers, &self.constants) else {
            return Ok(());
        };
        let queue = &self.gpu.queue;
        let write = |buffer: &wgpu::Buffer, bytes: &[u8]| {
            if !bytes.is_empty() {
                queue.write_buffer(buffer, 0, bytes);
            }
        };
        let number = |at: u32, value: usize| {
            queue.write_buffer(&buffers.state, at as u64 * 4, bytemuck::bytes_of(&(value as u32)));
        };
        number(slot::NEEDED_VISIBLE, frame.candidates.len());
        write(buffers.get("candidates"), bytemuck::cast_slice(&frame.candidates));
        if stage >= Stage::Project {
            let records = &frame.projections.records;
            let bits = f32::from_bits;
            let shapes: Vec<[f32; 8]> = records
                .iter()
                .map(|r| {
                    let ([u, v], [u00, u01, u11]) = (r.mean, r.factor);
                    [u, v, u00, u01, u11, r.opacity, bits(r.view), bits(r.splat)]
                })
                .collect();
            let shade = |c: [f32; 3], depth: f32| [c[0], c[1], c[2], depth];
            let shades: Vec<[f32; 4]> = records.iter().map(|r| shade(r.colour, r.depth)).collect();
            let counts = &frame.projections.counts;
            let keys: Vec<u32> = records.iter().zip(counts).map(|(r, &count)| depth_key(r.depth, count)).collect();
            write(buffers.get("records"), bytemuck::cast_slice(&shapes));
            write(buffers.get("shades"), bytemuck::cast_slice(&shades));
            write(buffers.get("counts"), bytemuck::cast_slice(counts));
            write(buffers.get("depth_keys"), bytemuck::cast_slice(&keys));
            if buffers.sizes.variant.plane {
                write(buffers.get("planes"), bytemuck::cast_slice(&frame.projections.planes));
            }
        }
        if stage >= Stage::SortByDepth {
            write(buffers.get(constants.order()), bytemuck::cast_slice(&frame.order));
        }
        if stage >= Stage::Emit {
            number(slot::NEEDED_ENTRIES, frame.entries.tiles.len());
            write(buffers.get("tiles"), bytemuck::cast_slice(&frame.entries.tiles));
            write(buffers.get("owners"), bytemuck::cast_slice(&frame.entries.records));
        }
        if stage >= Stage::SortByTile {
            let keep = buffers.sizes.variant.keep;
            let (tiles, sorted) = constants.sorted(keep);
            let of = |all: &[u32]| -> Vec<u32> { frame.sorted.iter().map(|&entry| all[entry as usize]).collect() };
            write(buffers.get(tiles), bytemuck::cast_slice(&of(&frame.entries.tiles)));
            // With `keep` the entries themselves are sorted, otherwise their records.
            let payloads = if keep { frame.sorted.clone() } else { of(&frame.entries.records) };
            write(buffers.get(sorted), bytemuck::cast_slice(&payloads));
        }
        if stage >= Stage::Ranges {
            write(buffers.get("ranges"), bytemuck::cast_slice(&frame.ranges));
        }
        Ok(())
    }
}
