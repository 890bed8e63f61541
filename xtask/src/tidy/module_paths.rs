//! What the text of a Rust file says of modules: which it declares, what it defines and imports, and which paths it
//! writes. A reader of tokens, not a parser: enough to see what leans on what.

/// One module with what its text says. A file holds one, and one more for each `mod name { ... }` within.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Module {
    /// Names from the module of the file down to this one; none for the module of the file.
    pub within: Vec<String>,
    /// Modules that have files of their own.
    pub children: Vec<String>,
    /// Names of items: functions, types, constants, ...
    pub items: Vec<String>,
    /// What is imported.
    pub imports: Vec<Import>,
    /// Paths in code outside imports; also those of a single name.
    pub paths: Vec<Vec<String>>,
}

/// One name of a `use`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Import {
    /// Path of what is imported, or of what a star stands behind.
    pub path: Vec<String>,
    /// Name in this module; `*` for all names.
    pub name: String,
    /// Whether others can take the name from here.
    pub is_public: bool,
}

/// Modules of a file. Expects comments, strings and tests to be blanked.
pub fn modules(code: &str) -> Vec<Module> {
    let tokens = tokens(code);
    let mut found = vec![Module::default()];
    // The modules that are open, innermost last, each with the depth of braces of its items.
    let mut open = vec![(0, 0)];
    let (mut depth, mut at) = (0, 0);
    while at < tokens.len() {
        let (here, level) = open[open.len() - 1];
        match tokens[at] {
            "{" => depth += 1,
            "}" => {
                depth -= 1;
                if depth < level {
                    open.pop();
                }
            }
            "mod" if tokens.get(at + 2) == Some(&"{") => {
                let mut within = found[here].within.clone();
                within.push(tokens[at + 1].into());
                found.push(Module { within, ..Module::default() });
                depth += 1;
                open.push((found.len() - 1, depth));
                at += 2;
            }
            "mod" => {
                found[here].children.extend(tokens.get(at + 1).map(|name| (*name).into()));
                at += 1;
            }
            "use" if tokens.get(at + 1) != Some(&"<") => {
                let is_public = at > 0 && ["pub", ")"].contains(&tokens[at - 1]);
                let mut reader = Reader { tokens: &tokens, at: at + 1, is_public, found: &mut found[here].imports };
                reader.tree(&[]);
                at = reader.at;
            }
            "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static"
                if tokens.get(at + 1).is_some_and(|name| is_name(name) && *name != "fn") =>
            {
                if depth == level {
                    found[here].items.push(tokens[at + 1].into());
                }
                at += 1;
            }
            "macro_rules" if depth == level => {
                found[here].items.extend(tokens.get(at + 2).map(|name| (*name).into()));
                at += 2;
            }
            name if is_name(name) => {
                let length = path_length(&tokens[at..]);
                let path: Vec<String> = tokens[at..at + length].iter().step_by(2).map(|name| (*name).into()).collect();
                if !is_silent(&tokens, at, length) {
                    found[here].paths.push(path);
                }
                at += length - 1;
            }
            _ => {}
        }
        at += 1;
    }
    found
}

/// Tokens of `name::name::...` from the first of `tokens` on.
fn path_length(tokens: &[&str]) -> usize {
    let more = tokens[1..].chunks_exact(2).take_while(|pair| pair[0] == "::" && is_name(pair[1])).count();
    1 + 2 * more
}

/// Whether a path says nothing: the rest of one that began with a type, and a lone name that is a field, or a variable,
/// which are small and not called.
fn is_silent(tokens: &[&str], at: usize, length: usize) -> bool {
    let before = at.checked_sub(1).map(|before| tokens[before]);
    let is_called = ["(", "!", "::"].map(Some).contains(&tokens.get(at + length).copied());
    let is_variable = tokens[at].starts_with(|c: char| c.is_lowercase()) && !is_called;
    let is_field = before == Some(".") || tokens.get(at + 1) == Some(&":");
    before == Some("::") || length == 1 && (is_field || is_variable)
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Names, `::`, and every other character that is not blank. Lifetimes are left out.
fn tokens(code: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let continues = |c: char| c.is_alphanumeric() || c == '_';
        let name = rest.find(|c| !continues(c)).unwrap_or(rest.len());
        let length = match first {
            '\'' => 1 + rest[1..].find(|c| !continues(c)).unwrap_or(rest.len() - 1),
            _ if name > 0 => name,
            _ if rest.starts_with("::") => 2,
            _ => first.len_utf8(),
        };
        if first != '\'' {
            found.push(&rest[..length]);
        }
        rest = rest[length..].trim_start();
    }
    found
}

/// Reads the tree of one `use`.
struct Reader<'a> {
    tokens: &'a [&'a str],
    at: usize,
    is_public: bool,
    found: &'a mut Vec<Import>,
}

impl Reader<'_> {
    /// Reads on to the `,`, `}` or `;` that ends the branch, which grows from the path `stem`.
    fn tree(&mut self, stem: &[String]) {
        let mut path = stem.to_vec();
        let mut name = None;
        while let Some(token) = self.tokens.get(self.at).copied() {
            match token {
                "," | "}" | ";" => break,
                "{" => return self.branches(&path),
                "*" => name = Some("*".to_owned()),
                "self" if !path.is_empty() => {}
                "as" => {
                    self.at += 1;
                    name = self.tokens.get(self.at).map(|name| (*name).to_owned());
                }
                token if is_name(token) => path.push(token.into()),
                _ => {}
            }
            self.at += 1;
        }
        if let Some(name) = name.or_else(|| path.last().cloned()) {
            self.found.push(Import { path, name, is_public: self.is_public });
        }
    }

    /// Reads `{a, b, ...}`.
    fn branches(&mut self, stem: &[String]) {
        while self.tokens.get(self.at).is_some_and(|token| *token != "}" && *token != ";") {
            self.at += 1;
            if self.tokens.get(self.at) != Some(&"}") {
                self.tree(stem);
            }
        }
        self.at += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn import(path: &[&str], name: &str, is_public: bool) -> Import {
        Import { path: path.iter().map(|name| (*name).into()).collect(), name: name.into(), is_public }
    }

    #[test]
    fn a_use_is_a_tree() {
        let found = modules("use a::{b, c::{self, D as E}, f::*};\npub(crate) use super::g;\nfn h() {}");
        let expected = [
            import(&["a", "b"], "b", false),
            import(&["a", "c"], "c", false),
            import(&["a", "c", "D"], "E", false),
            import(&["a", "f"], "*", false),
            import(&["super", "g"], "g", true),
        ];
        assert_eq!(found[0].imports, expected);
        assert_eq!(found[0].items, ["h"]);
    }

    #[test]
    fn modules_within_a_file_have_their_own_items() {
        let found = modules(
            "mod a;\nmod b { fn inner() { crate::c::d(); } }\nconst fn outer(x: u8) { x.y; x.z(); let v = X; v }",
        );
        assert_eq!(found[0].children, ["a"]);
        assert_eq!(found[0].items, ["outer"]);
        assert_eq!(found[1].within, ["b"]);
        assert_eq!(found[1].items, ["inner"]);
        assert_eq!(found[1].paths, [["crate", "c", "d"]]);
        assert_eq!(found[0].paths, [["X"]], "no fields, methods or variables");
    }
}
