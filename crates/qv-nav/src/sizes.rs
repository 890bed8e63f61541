//! How many numbers a network takes, keeps and gives.

use qv_policy::net::padded;

/// Columns and rows of the picture that the network sees: an eighth of the camera's 640 x 480.
pub const WIDTH: usize = 80;
/// See [`WIDTH`].
pub const HEIGHT: usize = 60;
/// Numbers beside the picture: goal colour as one of three, direction of gravity in the base. Neither the last command nor the turning rate is among
/// them: a teacher's command is like its last one, and a student that sees that copies it and does not look (de Haan et al. 2019).
pub const STATE: usize = 6;
/// How many of them are the colour; they come first.
pub const COLOUR: usize = 3;
/// Length of the memory.
pub const HIDDEN: usize = 192;
/// Numbers that come out: three of the command, then sine and cosine of the cone's bearing, the logarithm of its distance
/// from the base \[m\], since near the cone centimetres count, and whether it is in view.
pub const OUTPUTS: usize = 7;
/// How many of them are the command.
pub const COMMAND: usize = 3;
/// Numbers that it says besides, in training alone, so that it learns to know them: its place on the map (two shares of the map's half sides),
/// sine and cosine of its heading, the cone's place likewise.
pub const KNOWN: usize = 6;
/// Length of a row of what comes out, [`OUTPUTS`] and [`KNOWN`] first.
pub(crate) const RAW: usize = padded(OUTPUTS + KNOWN);
/// Directions in which it says how far a picture is free, see [`crate::recall::ray`].
pub const RAYS: usize = 12;
/// Numbers that it says of the picture alone, at the moment at which it was taken: sine and cosine of the cone's bearing from the base, logarithm of
/// its distance, whether it is in view; place on the map, sine and cosine of the heading; logarithms of the distance from the camera's foot to what
/// blocks along each ray, and of that to where the view of a cone ends.
pub const SIGHT: usize = 8 + 2 * RAYS;
/// Length of a row of what it says of pictures.
pub(crate) const RAW_SIGHT: usize = padded(SIGHT);
