//! What a file is that is no URDF.

/// What a file is whose root element has this name.
pub(crate) fn of_root(name: &str) -> String {
    let what = match name.to_ascii_lowercase().as_str() {
        "sdf" | "gazebo" => "SDF (Gazebo's format)",
        "mujoco" | "mujocoinclude" => "MJCF (MuJoCo's format)",
        "html" => "a web page, perhaps in place of a file that was not found",
        "collada" => "a COLLADA mesh",
        "launch" => "a launch file",
        "package" => "a manifest of a package",
        "svg" => "a drawing",
        _ => return format!("XML with the root <{name}>"),
    };
    format!("{what}, with the root <{name}>")
}

/// What a text is that is no XML, as far as its beginning shows; `reason` is what the parser said.
pub(crate) fn of_text(xml: &str, reason: &str) -> String {
    let start = xml.trim_start();
    let begins = |with: &str| start.get(..with.len()).is_some_and(|s| s.eq_ignore_ascii_case(with));
    if start.is_empty() {
        return "an empty file".into();
    }
    if begins("<!doctype html") || begins("<html") {
        return of_root("html");
    }
    if begins("version https://git-lfs") {
        return "a pointer of Git LFS in place of the file (`git lfs pull` fetches it)".into();
    }
    if let Some((_, root)) = ["<sdf", "<mujoco"].iter().filter(|r| begins(r)).map(|r| (r, &r[1..])).next() {
        return format!("{}, damaged: {reason}", of_root(root));
    }
    reason.to_owned()
}

/// Why a URDF is one that xacro has still to make, if it is.
pub(super) fn as_xacro(root: roxmltree::Node) -> Option<String> {
    let prefix_is_xacro = |n: &roxmltree::Node| {
        n.tag_name().namespace().is_some_and(|uri| uri.contains("xacro")) && n.tag_name().name() != "robot"
    };
    let mut elements = root.descendants().filter(roxmltree::Node::is_element);
    let found = elements.find(|n| prefix_is_xacro(n) || n.attributes().any(|a| a.value().contains("${")))?;
    let name = found.tag_name().name();
    Some(format!("xacro, not processed yet (<{name}>): `xacro FILE > robot.urdf` makes a URDF of it"))
}
