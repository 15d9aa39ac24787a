//! Repairs files that OpenSim reads and writes although they are not well-formed XML. Line numbers do not change.

use std::borrow::Cow;

use crate::error::SourceFile;

/// Replaces `::` in tags and bare `&`, and removes comments, in which OpenSim accepts `--`. Returns the file itself if
/// nothing changes.
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
                copy(rest, rest.find("]]>").map_or(rest.len(), |end| end + 3), &mut out)
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

/// Copies `length` bytes to `out` and returns the rest.
fn copy<'t>(text: &'t str, length: usize, out: &mut String) -> &'t str {
    out.push_str(&text[..length]);
    &text[length..]
}

/// Keeps `&name;`, `&#10;` and `&#x1f;`, and escapes any other `&`.
fn ampersand<'t>(text: &'t str, out: &mut String) -> &'t str {
    let name = text[1..].split_once(';').map_or("", |(name, _)| name);
    let is_entity = ["amp", "lt", "gt", "quot", "apos"].contains(&name)
        || name.strip_prefix("#x").is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_hexdigit()))
        || name.strip_prefix('#').is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    out.push_str(if is_entity { "&" } else { "&amp;" });
    &text[1..]
}

/// Replaces a comment by a blank, so that digits on both sides do not merge, and by its line breaks.
fn comment<'t>(text: &'t str, out: &mut String) -> &'t str {
    let Some(end) = text.find("-->").map(|end| end + 3) else { return copy(text, text.len(), out) };
    out.push(' ');
    out.extend(text[..end].chars().filter(|c| *c == '\n'));
    &text[end..]
}

/// Replaces `::` in the name of a tag, as in `<HuntCrossleyForce::ContactParametersSet>`.
fn tag<'t>(text: &'t str, out: &mut String) -> &'t str {
    let end = text[1..].find(|c: char| c.is_whitespace() || "><=".contains(c)).map_or(text.len(), |end| end + 1);
    out.push_str(&text[..end].replace("::", "__"));
    &text[end..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_invalid_xml_is_changed() {
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
