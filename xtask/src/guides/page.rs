//! The commands of a page in Markdown, and the lines that it says they print.

/// Lines of a page that stand for any number of others.
const ELLIPSIS: &str = "...";
/// Units of what a machine takes, which differs from run to run; the word `in` stands before the number.
const MEASURED: [&str; 3] = ["s", "min", "minutes"];
/// How a block begins whose commands run, and one that names what a reader has to bring, or takes many minutes.
const RUN: &str = "```console";
const OWN: &str = "```console own-data";

/// A command of a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Command {
    /// Its words, without the prompt and a comment.
    pub words: String,
    /// Lines that it is said to print, each with its index in the page.
    pub expected: Vec<(usize, String)>,
}

/// Lines that begin with a prompt in a block that says neither that it runs nor that it needs data of the reader, by number from 1.
pub fn untagged(page: &str) -> Vec<usize> {
    let (mut found, mut is_tagged) = (vec![], false);
    for (index, line) in page.lines().enumerate() {
        if line.starts_with("```") {
            is_tagged = [RUN, OWN].contains(&line);
        } else if !is_tagged && line.starts_with("$ ") {
            found.push(index + 1);
        }
    }
    found
}

/// The commands of all blocks of `console`, in order.
pub fn commands(page: &str) -> Vec<Command> {
    let mut found: Vec<Command> = vec![];
    let mut is_inside = false;
    for (index, line) in page.lines().enumerate() {
        if line.starts_with("```") {
            is_inside = line == RUN;
            continue;
        }
        if !is_inside || line.trim() == ELLIPSIS || line.trim().is_empty() {
            continue;
        }
        if let Some(words) = line.strip_prefix("$ ") {
            let words = words.split(" #").next().unwrap_or(words).trim().to_string();
            found.push(Command { words, expected: vec![] });
        } else if let Some(command) = found.last_mut() {
            command.expected.push((index, line.to_string()));
        }
    }
    found
}

/// A number in a line, and whether it is of the machine rather than of the work.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Number {
    value: f64,
    /// One unit in the last place that is printed; none of a whole number, which counts something.
    unit: f64,
    is_measured: bool,
}

/// A line with its numbers taken out, and these.
fn split(line: &str) -> (String, Vec<Number>) {
    let squeezed = line.split_whitespace().collect::<Vec<_>>().join(" ");
    let bytes: Vec<char> = squeezed.chars().collect();
    let (mut text, mut numbers, mut at) = (String::new(), vec![], 0);
    while at < bytes.len() {
        if !bytes[at].is_ascii_digit() {
            text.push(bytes[at]);
            at += 1;
            continue;
        }
        let start = at;
        while at < bytes.len()
            && (bytes[at].is_ascii_digit() || bytes[at] == '.' && bytes.get(at + 1).is_some_and(char::is_ascii_digit))
        {
            at += 1;
        }
        let digits: String = bytes[start..at].iter().collect();
        let after: String = bytes[at..].iter().collect();
        let word = after.trim_start().split(|c: char| !c.is_alphanumeric()).next().unwrap_or("");
        let unit = digits.split_once('.').map_or(0.0, |(_, fraction)| 0.1f64.powi(fraction.len() as i32));
        let is_measured = text.ends_with("in ") && MEASURED.contains(&word);
        numbers.push(Number { value: digits.parse().unwrap_or(f64::NAN), unit, is_measured });
        text.push('#');
    }
    (text, numbers)
}

/// Whether a program printed a line that a page has, but for numbers of the machine.
fn agrees(expected: &str, printed: &str) -> bool {
    let ((text, numbers), (other, others)) = (split(expected), split(printed));
    let is_close = |(a, b): (&Number, &Number)| a.is_measured || (a.value - b.value).abs() <= a.unit * (1.0 + 1e-9);
    text == other && numbers.iter().zip(&others).all(is_close)
}

/// Which lines of `expected` a program did not print, each with the printed line that differs from it in numbers alone, if there is one.
/// Lines are printed in the order in which the page has them.
pub fn differences<'a>(command: &'a Command, printed: &str) -> Vec<(usize, &'a str, Option<String>)> {
    let mut rest: Vec<&str> = printed.lines().collect();
    let mut found = vec![];
    for (index, line) in &command.expected {
        match rest.iter().position(|other| agrees(line, other)) {
            Some(place) => _ = rest.drain(..=place),
            None => {
                let alike = rest.iter().find(|other| split(line).0 == split(other).0);
                found.push((*index, line.as_str(), alike.map(|other| other.trim_end().to_string())));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "# A page\n```console\n$ qv demo   # a comment\n...\nFound: friction 0.45 N m, in 16 s\n$ qv view a\n```\n```toml\n$ no\n```\n";

    #[test]
    fn commands_and_their_lines_are_read() {
        let found = commands(PAGE);
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].words.as_str(), found[1].words.as_str()), ("qv demo", "qv view a"));
        assert_eq!(found[0].expected, [(4, "Found: friction 0.45 N m, in 16 s".to_string())]);
    }

    #[test]
    fn figures_are_compared_and_times_are_not() {
        let command = &commands(PAGE)[0];
        assert_eq!(differences(command, "first\n  Found: friction 0.45 N m,  in 99 s\n"), []);
        assert_eq!(differences(command, "Found: friction 0.46 N m, in 1 s\n"), [], "within a unit of the last place");
        let moved = differences(command, "Found: friction 0.47 N m, in 1 s\n");
        assert_eq!(moved.len(), 1);
        assert_eq!(moved[0].2.as_deref(), Some("Found: friction 0.47 N m, in 1 s"));
        assert_eq!(differences(command, "Nothing\n")[0].2, None);
    }

    #[test]
    fn counts_are_exact_and_only_times_after_in_are_of_the_machine() {
        let command = &commands("```console\n$ a\n0 of 64 fell; a swing lasts 0.20 s\n```\n")[0];
        assert_eq!(differences(command, "0 of 64 fell; a swing lasts 0.21 s"), []);
        assert_eq!(differences(command, "1 of 64 fell; a swing lasts 0.20 s").len(), 1);
        assert_eq!(differences(command, "0 of 64 fell; a swing lasts 0.30 s").len(), 1);
    }

    #[test]
    fn a_prompt_outside_of_a_tagged_block_is_found() {
        assert_eq!(untagged("```console\n$ a\n```\n```console own-data\n$ b\n```\n```\n$ c\n```\n"), [8]);
    }

    #[test]
    fn lines_come_in_the_order_of_the_page() {
        let command = &commands("```console\n$ a\none 1\ntwo 2\n```\n")[0];
        assert_eq!(differences(command, "one 1\ntwo 2\n"), []);
        assert_eq!(differences(command, "two 2\none 1\n").len(), 1);
    }
}
