//! The elements of a URDF that a simulator reads, each with the line where it stands.
//!
//! A reader of our own on top of an XML tree, for three reasons: a derived one stops at elements that are of no use here (a
//! second `<material>`), it cannot say in which link, joint and line something is missing, and it walks the nesting of a
//! file on the program's stack. The tree here is built without recursion, so nesting of any depth costs memory alone.
//!
//! Elements and attributes: <https://wiki.ros.org/urdf/XML>. `quat_xyzw` is read from version 1.1 on; from version 1.2 on, a
//! limit that is absent is none.

pub(crate) mod attributes;
mod elements;
pub(crate) mod kinds;
pub(crate) mod read;
mod text;

pub use elements::{
    Collision, Dynamics, Geometry, Inertial, JointElement, JointType, Limit, LinkElement, Origin, Robot,
};
pub use text::decode;

use crate::SimError;

impl Robot {
    /// Reads the text of a URDF; [`decode`] makes text of a file's bytes.
    ///
    /// # Errors
    /// The text is no XML or another kind of file, which is named; or an element lacks what it needs, or has a value that is
    /// no number: link or joint and line are named.
    pub fn parse(xml: &str) -> Result<Self, SimError> {
        read::robot(xml)
    }
}
