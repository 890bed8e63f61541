//! Where pictures are drawn and what is learnt: on the CPU, or on a graphics card.

use crate::Failure;
use qv_nav::dagger::{Student, TrainSettings};
use qv_nav::eye::{Eye, SplatEye};
use qv_nav::places::PlaceEyes;

/// The graphics card, in a program that was built with the feature `gpu`.
#[derive(clap::Args)]
pub struct CardArguments {
    /// Render and train on the GPU
    #[cfg(feature = "gpu")]
    #[arg(long, help_heading = "Advanced", hide_short_help = true)]
    gpu: bool,
    /// Select the GPU by index, from 0
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "N", requires = "gpu", help_heading = "Advanced", hide_short_help = true)]
    gpu_index: Option<usize>,
}

#[cfg(feature = "gpu")]
impl CardArguments {
    /// The eye where it was asked for.
    pub fn eye(&self, eye: SplatEye) -> Result<Box<dyn Eye>, Failure> {
        use qv_nav::card::GpuEye;
        Ok(if self.gpu { Box::new(GpuEye::new(&eye, self.open()?)?) } else { Box::new(eye) })
    }

    /// What draws one place after another.
    pub fn place_eyes(&self) -> Result<PlaceEyes, Failure> {
        use qv_nav::card::GpuEyes;
        Ok(if self.gpu { PlaceEyes::Card(Box::new(GpuEyes::new(self.options())?)) } else { PlaceEyes::Processor })
    }

    /// A student, likewise.
    pub fn student(&self, settings: &TrainSettings) -> Result<Student, Failure> {
        let student = Student::new(settings)?;
        Ok(if self.gpu { student.on_card(self.open()?)? } else { student })
    }

    /// Each eye and the student have a device of their own: none waits for what the other has submitted.
    fn open(&self) -> Result<qv_nav::card::Gpu, Failure> {
        Ok(qv_nav::card::Gpu::new(&self.options())?)
    }

    fn options(&self) -> qv_nav::card::GpuOptions {
        qv_nav::card::GpuOptions { adapter: self.gpu_index, ..Default::default() }
    }
}

#[cfg(not(feature = "gpu"))]
impl CardArguments {
    /// The eye.
    pub fn eye(&self, eye: SplatEye) -> Result<Box<dyn Eye>, Failure> {
        Ok(Box::new(eye))
    }

    /// What draws one place after another.
    pub fn place_eyes(&self) -> Result<PlaceEyes, Failure> {
        Ok(PlaceEyes::Processor)
    }

    /// A student.
    pub fn student(&self, settings: &TrainSettings) -> Result<Student, Failure> {
        Ok(Student::new(settings)?)
    }
}
