//! A look at the text of an XML file before it is parsed: the parser compares each attribute of an element with all others.

/// Attributes that an element may have: those of the largest in MJCF are some 50.
const MOST: usize = 1000;

/// # Errors
/// In words, and where, if an element has more attributes than any robot's.
pub(crate) fn check(xml: &str) -> Result<(), String> {
    let mut rest = xml;
    while let Some(at) = rest.find('<') {
        rest = &rest[at..];
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((_, end)) = skipped.iter().find(|(begin, _)| rest.starts_with(begin)) {
            // Without an end it is the parser's to say so.
            let Some(end) = rest.find(end) else { return Ok(()) };
            rest = &rest[end..];
            continue;
        }
        let (count, length) = attributes(rest);
        if count > MOST {
            let line = 1 + xml[..xml.len() - rest.len()].matches('\n').count();
            return Err(format!("an element of more than {MOST} attributes in line {line}"));
        }
        rest = &rest[length..];
    }
    Ok(())
}

/// Attributes of the tag that a text begins with, and its length \[bytes\].
fn attributes(tag: &str) -> (usize, usize) {
    let (mut count, mut quote) = (0, None);
    for (at, byte) in tag.bytes().enumerate() {
        match (quote, byte) {
            (Some(mark), _) if mark == byte => quote = None,
            (Some(_), _) => {}
            (None, b'"' | b'\'') => {
                quote = Some(byte);
                count += 1;
            }
            (None, b'>') => return (count, at),
            (None, _) => {}
        }
    }
    (count, tag.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::States;

    #[test]
    fn attributes_are_counted_in_tags_alone() {
        let many = |n: usize| (0..n).map(|k| format!(" a{k}='1'")).collect::<String>();
        assert_eq!(check(&format!("<robot{}><link b='>'/></robot>", many(MOST))), Ok(()));
        let error = check(&format!("<robot>\n<link{}/></robot>", many(MOST + 1)));
        assert!(error.is_err_and(|error| error.states("line 2")));
        for hidden in [format!("<!-- {} -->", many(2000)), format!("<r><![CDATA[<a {}>]]></r>", many(2000))] {
            assert_eq!(check(&hidden), Ok(()));
        }
        assert_eq!(check("<robot a=\"'>\" b='\">'>it's < \"x"), Ok(()));
    }
}
