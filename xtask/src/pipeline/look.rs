//! Pages as a browser shows them: headless Chromium lays each out and says what a reader would see.

use crate::process;
use anyhow::{Context, Result, bail};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Names that the browser goes by.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
/// Widths of a desk's screen and of a telephone \[px\].
const WIDTHS: [u32; 2] = [1280, 400];
/// Height of the picture that is taken \[px\].
const HEIGHT: u32 = 2400;
/// A picture of a page with something on it is larger \[bytes\]; an empty one of this size has about a tenth.
const SMALLEST: u64 = 60_000;

/// Runs in the page once it is there, and leaves what it measured as text.
const MEASURE: &str = "addEventListener('load',()=>{\
const size=e=>{const r=e.getBoundingClientRect();return r.width*r.height};\
const all=q=>[...document.querySelectorAll(q)];\
const pre=document.createElement('pre');pre.id='measured';\
const found={\
headings:all('h1,h2').map(e=>e.textContent.trim()),\
images:all('img').length,\
broken:all('img').filter(e=>!e.complete||e.naturalWidth===0||size(e)<100).length,\
drawings:all('svg,canvas').length,\
empty:all('svg,canvas').filter(e=>size(e)<100||e.tagName!=='CANVAS'&&e.children.length===0).length,\
overflow:document.documentElement.scrollWidth-document.documentElement.clientWidth,\
words:document.body.innerText.split(/\\s+/).length,\
nonsense:[...new Set(document.body.innerText.match(/\\b(NaN|undefined|Infinity|inf)\\b/g)||[])]};\
pre.textContent=JSON.stringify(found).replace(/[&<>]/g,' ');document.body.append(pre)})";

/// What a page looks like at one width.
#[derive(Debug, Default, PartialEq, Deserialize)]
struct PageSize {
    headings: Vec<String>,
    images: usize,
    /// Images without pixels.
    broken: usize,
    drawings: usize,
    /// Drawings without an extent, or with nothing in them.
    empty: usize,
    /// Pixels by which the page is wider than the window.
    overflow: i64,
    words: usize,
    /// Words that no report should have.
    nonsense: Vec<String>,
}

/// The browser, if one is there.
pub fn browser() -> Option<PathBuf> {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let known = BROWSERS.iter().map(PathBuf::from);
    named.into_iter().chain(known).find(|name| process::works(Command::new(name).arg("--version")))
}

/// What is wrong with a page in words, at the widths of a desk and a telephone; empty when nothing is. A picture of it is left as
/// `NAME.png` beside it.
///
/// # Errors
/// The browser fails, or a file cannot be written.
pub fn faults(browser: &Path, page: &Path) -> Result<Vec<String>> {
    let mut found = vec![];
    for width in WIDTHS {
        found.extend(wrong(&measure(browser, page, width)?).into_iter().map(|what| format!("{width} px wide: {what}")));
    }
    let picture = page.with_extension("png");
    take_picture(browser, page, &picture)?;
    let size = fs::metadata(&picture).with_context(|| format!("no picture {}", picture.display()))?.len();
    if size < SMALLEST {
        found.push(format!("expected a picture of more than {SMALLEST} bytes, found {size}: is the page empty?"));
    }
    Ok(found.into_iter().map(|what| format!("{}, {what}", page.display())).collect())
}

/// Writes a picture of a page as a desk's screen shows it.
///
/// # Errors
/// The browser fails.
pub fn take_picture(browser: &Path, page: &Path, picture: &Path) -> Result<()> {
    let mut take = headless(browser, WIDTHS[0]);
    take.arg(format!("--screenshot={}", picture.display())).arg(address(page)?);
    process::run(take.stdout(Stdio::null()).stderr(Stdio::null()))
}

fn wrong(page: &PageSize) -> Vec<String> {
    let mut found = vec![];
    let mut expect = |holds: bool, what: String| {
        if !holds {
            found.push(what);
        }
    };
    expect(!page.headings.is_empty(), "expected a heading, found none".into());
    expect(page.words >= 50, format!("expected at least 50 words, found {}", page.words));
    expect(page.images + page.drawings > 0, "expected a picture, found none".into());
    expect(page.broken == 0, format!("{} of {} images show nothing", page.broken, page.images));
    expect(page.empty == 0, format!("{} of {} drawings show nothing", page.empty, page.drawings));
    expect(page.overflow <= 0, format!("{} px wider than the window", page.overflow));
    expect(page.nonsense.is_empty(), format!("says {}", page.nonsense.join(", ")));
    found
}

fn headless(browser: &Path, width: u32) -> Command {
    let mut command = Command::new(browser);
    // No sandbox: continuous integration runs as root, and pages are our own.
    command.args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=5000"]);
    command.arg(format!("--window-size={width},{HEIGHT}"));
    command
}

/// The address of a file.
///
/// # Errors
/// There is none.
pub fn address(page: &Path) -> Result<String> {
    Ok(format!("file://{}", page.canonicalize().with_context(|| format!("no page {}", page.display()))?.display()))
}

/// A page whose policy allows one more script; all else that it forbids stays forbidden.
fn with_script(page: &str, script: &str) -> String {
    let hash = format!("'sha256-{}'", STANDARD.encode(Sha256::digest(script.as_bytes())));
    let allowed = page.replacen("script-src 'none'", &format!("script-src {hash}"), 1);
    let allowed =
        if allowed == page { page.replacen("script-src ", &format!("script-src {hash} "), 1) } else { allowed };
    format!("{allowed}<script>{script}</script>")
}

/// A copy of a page with a script, beside it.
///
/// # Errors
/// A file cannot be read or written.
pub fn copy_with(page: &Path, script: &str) -> Result<PathBuf> {
    let text = fs::read_to_string(page).with_context(|| format!("reading {}", page.display()))?;
    let copy = page.with_extension("measured.html");
    fs::write(&copy, with_script(&text, script)).with_context(|| format!("writing {}", copy.display()))?;
    Ok(copy)
}

/// What a script leaves as text in an element `<pre id="measured">` of a page.
///
/// # Errors
/// The browser fails, or a file cannot be read or written.
pub fn evaluate(page: &Path, script: &str, browser: &mut Command) -> Result<String> {
    let copy = copy_with(page, script)?;
    // What it says of the machine, as of a bus that is not there, is nobody's concern.
    let shown = browser.arg("--dump-dom").arg(address(&copy)?).stderr(Stdio::null()).output();
    fs::remove_file(&copy).with_context(|| format!("removing {}", copy.display()))?;
    let shown = shown.with_context(|| format!("cannot start {browser:?}"))?;
    let said = String::from_utf8_lossy(&shown.stdout);
    let found = said.rsplit_once("<pre id=\"measured\">").and_then(|(_, rest)| rest.split_once("</pre>"));
    let Some((found, _)) = found else { bail!("{}: the browser measured nothing", page.display()) };
    Ok(found.to_owned())
}

fn measure(browser: &Path, page: &Path, width: u32) -> Result<PageSize> {
    let found = evaluate(page, MEASURE, &mut headless(browser, width))?;
    serde_json::from_str(&found).with_context(|| format!("what was measured of {}", page.display()))
}

#[cfg(test)]
#[path = "../../../fixtures/skipped.rs"]
mod skipped;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_policy_allows_the_measuring_script_and_nothing_more() {
        let policy = |sources: &str| format!("<meta content=\"default-src 'none'; script-src {sources}\"><p>");
        let hash = with_script(&policy("'none'"), MEASURE);
        let hash = hash.split("script-src ").nth(1).and_then(|rest| rest.split('\"').next()).unwrap();
        assert!(hash.starts_with("'sha256-") && !hash.contains(' '), "{hash}");
        assert!(with_script(&policy("'sha256-own'"), MEASURE).starts_with(&policy(&format!("{hash} 'sha256-own'"))));
        assert_eq!(with_script("<p>", MEASURE), format!("<p><script>{MEASURE}</script>"));
    }

    fn looked_at(name: &str, body: &str) -> Option<Vec<String>> {
        let Some(browser) = browser() else {
            skipped::skipped("no Chromium");
            return None;
        };
        let folder = std::env::temp_dir().join(format!("qv-look-{}-{name}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let page = folder.join("page.html");
        fs::write(&page, format!("<!doctype html><meta charset=\"utf-8\">{body}")).unwrap();
        let found = faults(&browser, &page).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        Some(found)
    }

    #[test]
    fn a_page_that_shows_nothing_is_found() {
        let words = "word ".repeat(60);
        let body = format!(
            "<h1>Grüße</h1><p>{words} NaN</p><img src=\"missing.png\"><svg width=\"50\" height=\"50\"></svg>\
             <div style=\"width:3000px\">wide</div>"
        );
        let Some(found) = looked_at("bad", &body) else { return };
        for what in ["1 of 1 images", "1 of 1 drawings", "wider than the window", "says NaN", "is the page empty"] {
            assert!(found.iter().any(|line| line.contains(what)), "{what}: {found:?}");
        }
    }

    #[test]
    fn a_page_that_shows_something_passes() {
        let squares: String = (0..4000)
            .map(|k| {
                let (x, y) = (k % 80 * 5, k / 80 * 5);
                format!("<rect x=\"{x}\" y=\"{y}\" width=\"5\" height=\"5\" fill=\"#{:06x}\"/>", k * 4099)
            })
            .collect();
        let svg = format!("<svg viewBox=\"0 0 400 250\" style=\"width:100%;display:block\">{squares}</svg>");
        let Some(found) = looked_at("good", &format!("<h1>All</h1><p>{}</p>{svg}", "word ".repeat(60))) else { return };
        assert!(found.is_empty(), "{found:?}");
    }
}
