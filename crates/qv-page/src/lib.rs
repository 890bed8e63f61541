//! Pages of this workspace: one HTML file, everything inside, no network, light or dark as the reader's screen is.
//!
//! A page is text: [`Page`] is the frame around it, [`parts`] are cards, tables and bars, [`picture`] is what drawings share, and
//! a [`Board`] is plots that one can use. Its numbers are in the page as packed columns, rounded to a step that the caller
//! names, since nobody sees more ([`pack`]); `plots.js` draws them. Without a script a board is a drawing of its first choice.
//!
//! What a user of a board can do:
//!
//! | do | what happens |
//! |---|---|
//! | move the pointer, tap, arrow keys | time and value of each line |
//! | drag | zooms all plots of the board, and boards of the same `link` |
//! | double click, Escape, `whole` | the whole again |
//! | `‹` and `›` | the stretch before or after |
//! | click a name | switches that line off or on |
//! | choose | another joint, channel, stretch |
//! | `PNG`, `CSV` | what is shown, as a picture or a table |

pub mod board;
#[cfg(test)]
#[path = "../../../fixtures/facts.rs"]
mod facts;
mod frame;
mod html;
pub mod number;
pub mod pack;
pub mod parts;
pub mod picture;
mod policy;
pub mod read;
mod still;
mod text;

pub use board::{Band, Board, Choice, Column, Line, Look, Panel, Stretch};
pub use frame::{Page, TOKENS};
pub use number::{fixed, percent, significant};
pub use parts::Table;
pub use policy::policy;
pub use text::{escape, script_data};
