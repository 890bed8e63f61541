//! The end of the help of every command: examples, results, exit codes.

/// The end of a command's `--help`: examples and results, then exit codes; the second argument is what code 3 means.
macro_rules! help_text {
    ($text:literal) => {
        concat!($text, "\n\nExit codes:\n  0 done, 1 failed, 2 usage error, 130 interrupted")
    };
    ($text:literal, $partial:literal) => {
        concat!($text, "\n\nExit codes:\n  0 done, 1 failed, 2 usage error, 130 interrupted\n  ", $partial)
    };
}
pub(crate) use help_text;
