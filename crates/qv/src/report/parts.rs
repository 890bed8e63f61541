//! What a page is made of.

use qv_core::TriangleMesh;
use serde_json::Value;

/// What the page is made of; `None` = not given.
pub(super) struct Parts {
    pub(super) scores: Option<Value>,
    /// Name and PNG of photographs beside what is drawn.
    pub(super) pictures: Vec<(String, Vec<u8>)>,
    pub(super) mesh: Option<TriangleMesh>,
    pub(super) contact: Option<Value>,
    pub(super) replay: Option<Value>,
    pub(super) diagnosis: Option<Value>,
    pub(super) tuning: Option<Value>,
    pub(super) paths: Option<Value>,
    /// Results of `qv navigate test`, and the way to their page.
    pub(super) navigation: Option<(Value, String)>,
    /// The page of `qv view`, as one gets there from this one.
    pub(super) view: Option<String>,
}
