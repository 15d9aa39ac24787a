//! What OpenSim reads and writes although it is not well-formed XML, made well-formed, line by line as it was.

use std::borrow::Cow;

use crate::error::SourceFile;

/// The file with `::` in tags and bare `&` repaired, and without its comments, which OpenSim lets hold `--`; the file itself where there are none.
pub fn repaired(file: &SourceFile) -> Cow<'_, SourceFile> {
    let text = file.text.trim_start_matches('\u{feff}');
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(['<', '&']) {
        out.push_str(&rest[..at]);
        rest = &rest[at..];
        rest = match rest {
            _ if rest.starts_with('&') => ampersand(rest, &mut out),
            _ if rest.starts_with("<!--") => comment(rest, &mut out),
            _ if rest.starts_with("<![CDATA[") => {
                copied(rest, rest.find("]]>").map_or(rest.len(), |end| end + 3), &mut out)
            }
            _ => tag(rest, &mut out),
        };
    }
    out.push_str(rest);
    match out == file.text {
        true => Cow::Borrowed(file),
        false => Cow::Owned(SourceFile { path: file.path.clone(), text: out }),
    }
}

fn copied<'t>(text: &'t str, length: usize, out: &mut String) -> &'t str {
    out.push_str(&text[..length]);
    &text[length..]
}

/// `&name;`, `&#10;` and `&#x1f;` stay; any other `&` is one that was meant.
fn ampersand<'t>(text: &'t str, out: &mut String) -> &'t str {
    let name = text[1..].split_once(';').map_or("", |(name, _)| name);
    let is_entity = ["amp", "lt", "gt", "quot", "apos"].contains(&name)
        || name.strip_prefix("#x").is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_hexdigit()))
        || name.strip_prefix('#').is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    out.push_str(if is_entity { "&" } else { "&amp;" });
    &text[1..]
}

/// A blank, so that a number with a comment in it is no other number; lines stay lines.
fn comment<'t>(text: &'t str, out: &mut String) -> &'t str {
    let Some(end) = text.find("-->").map(|end| end + 3) else { return copied(text, text.len(), out) };
    out.push(' ');
    out.extend(text[..end].chars().filter(|c| *c == '\n'));
    &text[end..]
}

/// A scope in the name of a tag: `<HuntCrossleyForce::ContactParametersSet>`.
fn tag<'t>(text: &'t str, out: &mut String) -> &'t str {
    let end = text[1..].find(|c: char| c.is_whitespace() || "><=".contains(c)).map_or(text.len(), |end| end + 1);
    out.push_str(&text[..end].replace("::", "__"));
    &text[end..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_no_xml_changes() {
        let repaired = |text: &str| {
            let file = SourceFile { path: "a.osim".into(), text: text.to_owned() };
            repaired(&file).text.clone()
        };
        for (found, expected) in [
            ("<a>1 &amp; 2 &#65; &#x4f;</a>", "<a>1 &amp; 2 &#65; &#x4f;</a>"),
            ("<a>R & D; &co;</a>", "<a>R &amp; D; &amp;co;</a>"),
            ("<H::Set name=\"x::y\">a::b</H::Set>", "<H__Set name=\"x::y\">a::b</H__Set>"),
            ("<!-- a -- b\n --><a/>", " \n<a/>"),
            ("<a>1<!-- x -->.6</a>", "<a>1 .6</a>"),
            ("<![CDATA[ & -- ]]><a/>", "<![CDATA[ & -- ]]><a/>"),
            ("\u{feff}<a/>", "<a/>"),
        ] {
            assert_eq!(repaired(found), expected);
            assert!(roxmltree::Document::parse(expected).is_ok() || !expected.starts_with("<a"), "{expected}");
        }
    }
}
