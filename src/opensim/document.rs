//! OpenSim's XML, of any version from 1 to 4, read with places for errors.
//!
//! The document has no DTD (so no entities to expand) and no more than [`NODES`] nodes; looking into it never recurses.

use std::collections::HashMap;

use roxmltree::{Document, Node, ParsingOptions};

use crate::error::{Error, Result, SourceFile};

/// More nodes than any model has.
const NODES: u32 = 1_000_000;

/// An element, and where to find what it leaves out.
#[derive(Clone, Copy)]
pub struct Element<'d> {
    pub node: Node<'d, 'd>,
    pub file: &'d SourceFile,
}

/// Elements of the file's `<defaults>`, by tag.
pub type Defaults<'d> = HashMap<&'d str, Element<'d>>;

/// Parses a file.
///
/// # Errors
/// If it is no XML, has a DTD, or too many nodes.
pub fn parse(file: &SourceFile) -> Result<Document<'_>> {
    let options = ParsingOptions { allow_dtd: false, nodes_limit: NODES, ..ParsingOptions::default() };
    Document::parse_with_options(&file.text, options).map_err(|e| {
        let help = match e {
            roxmltree::Error::DtdDetected => "an OpenSim file has no <!DOCTYPE …>: remove it",
            roxmltree::Error::NodesLimitReached => "no model has a million elements: is this the right file?",
            _ => "an OpenSim model is an XML file that OpenSim has written; open and save it there",
        };
        let place = file.line_span(e.pos().row as usize);
        file.error(place, format!("this is not XML: {e}"), "here", Some(help.to_owned()))
    })
}

impl<'d> Element<'d> {
    pub fn tag(&self) -> &'d str {
        self.node.tag_name().name()
    }

    /// The attribute `name`, empty if there is none.
    pub fn name(&self) -> &'d str {
        self.node.attribute("name").unwrap_or("").trim()
    }

    pub fn children(&self) -> impl Iterator<Item = Element<'d>> + use<'d> {
        let file = self.file;
        self.node.children().filter(Node::is_element).map(move |node| Element { node, file })
    }

    pub fn child(&self, tag: &str) -> Option<Element<'d>> {
        self.children().find(|child| child.tag() == tag)
    }

    /// The first child of one of these tags, which other versions of OpenSim write.
    pub fn either(&self, tags: &[&str]) -> Option<Element<'d>> {
        tags.iter().find_map(|tag| self.child(tag))
    }

    /// Elements of a set, directly or within its `<objects>`; none if the set is not there.
    pub fn objects(&self, tags: &[&str]) -> Vec<Element<'d>> {
        let Some(set) = self.either(tags) else { return Vec::new() };
        match set.child("objects") {
            Some(objects) => objects.children().collect(),
            None => set.children().filter(|child| child.tag() != "groups").collect(),
        }
    }

    /// Whether it has a function, of any kind; an empty `<function/>` is none.
    pub fn has_function(&self) -> bool {
        let holds = |child: Element<'d>| child.tag() == "function" && child.children().next().is_some();
        self.children().any(|child| holds(child) || child.name() == "function")
    }

    /// All elements below with this tag.
    pub fn descendants(&self, tag: &'static str) -> impl Iterator<Item = Element<'d>> + use<'d> {
        let file = self.file;
        self.node.descendants().filter(move |node| node.has_tag_name(tag)).map(move |node| Element { node, file })
    }

    /// Trimmed text of a child; `None` if absent or empty.
    pub fn text(&self, tag: &str) -> Option<&'d str> {
        self.child(tag)?.own_text()
    }

    pub fn own_text(&self) -> Option<&'d str> {
        self.node.text().map(str::trim).filter(|text| !text.is_empty())
    }

    /// Whether a child says true; `default` if absent.
    pub fn flag(&self, tag: &str, default: bool) -> bool {
        self.text(tag).map_or(default, |text| text.eq_ignore_ascii_case("true") || text == "1")
    }

    /// Numbers of a child.
    ///
    /// # Errors
    /// If one of them is no number.
    pub fn numbers(&self, tag: &str) -> Result<Option<Vec<f64>>> {
        let Some(child) = self.child(tag) else { return Ok(None) };
        let number = |text: &str| {
            let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
            number.ok_or_else(|| child.error(format!("`{text}` is no finite number"), "write a finite decimal number"))
        };
        let text = child.own_text().unwrap_or("").trim_matches(['(', ')']);
        let numbers: Vec<f64> = text
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|t| !t.is_empty())
            .map(number)
            .collect::<Result<_>>()?;
        Ok((!numbers.is_empty()).then_some(numbers))
    }

    /// # Errors
    /// If the child holds anything but one number.
    pub fn number(&self, tag: &str) -> Result<Option<f64>> {
        Ok(self.vector::<1>(tag)?.map(|[x]| x))
    }

    /// # Errors
    /// If the child holds anything but N numbers.
    pub fn vector<const N: usize>(&self, tag: &str) -> Result<Option<[f64; N]>> {
        let Some(numbers) = self.numbers(tag)? else { return Ok(None) };
        let found = numbers.len();
        let wrong = || self.error(format!("<{tag}> has {found} number(s)"), &format!("it has {N} number(s)"));
        numbers.try_into().map(Some).map_err(|_| wrong())
    }

    /// What another element is named in: a socket of version 4 (three spellings), or an element of an older one.
    pub fn reference(&self, socket: &str, older: &[&str]) -> Option<&'d str> {
        let connector = || {
            let connectors = self.child("connectors")?;
            connectors.children().find(|connector| connector.name() == socket)?.text("connectee_name")
        };
        (self.text(&format!("socket_{socket}")))
            .or_else(|| self.text(&format!("socket_{socket}_connectee_name")))
            .or_else(connector)
            .or_else(|| older.iter().find_map(|tag| self.text(tag)))
    }

    /// An error that points at the element's first line.
    pub fn error(&self, message: impl Into<String>, help: &str) -> Error {
        let range = self.node.range();
        let line = self.file.text[range.clone()].find('\n').map_or(range.end, |n| range.start + n);
        self.file.error(Some(range.start..line), message, "here", Some(help.to_owned()))
    }
}
