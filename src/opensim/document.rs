//! Access to OpenSim's XML, versions 1 to 4, with locations for error messages.
//!
//! Files are not trusted: a DTD (and with it the expansion of entities) is refused, as are more than [`MAX_NODES`]
//! nodes, and no search recurses.

use std::collections::HashMap;

use roxmltree::{Document, Node, ParsingOptions};

use crate::error::{Error, Result, SourceFile};
use crate::names::counted;

/// Maximum number of nodes, more than any model has.
const MAX_NODES: u32 = 1_000_000;

/// An element, and its file.
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
/// If it is not valid XML, has a DTD, or has too many nodes.
pub fn parse(file: &SourceFile) -> Result<Document<'_>> {
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    Document::parse_with_options(&file.text, options).map_err(|e| {
        let help = match e {
            roxmltree::Error::DtdDetected => "OpenSim files have no <!DOCTYPE …>: remove it",
            roxmltree::Error::NodesLimitReached => "no model has a million nodes: check that this is the right file",
            _ => "an OpenSim model is an XML file written by OpenSim; open and save it there",
        };
        let place = file.line_span(e.pos().row as usize);
        file.error(place, format!("not valid XML: {e}"), "here", Some(help.to_owned()))
    })
}

impl<'d> Element<'d> {
    pub fn tag(&self) -> &'d str {
        self.node.tag_name().name()
    }

    /// The attribute `name`; empty if absent.
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

    /// The child with the first of these tags that is present. Tags differ between versions of OpenSim.
    pub fn either(&self, tags: &[&str]) -> Option<Element<'d>> {
        tags.iter().find_map(|tag| self.child(tag))
    }

    /// Elements of a set, either directly in it or in its `<objects>`; none if the set is absent.
    pub fn objects(&self, tags: &[&str]) -> Vec<Element<'d>> {
        let Some(set) = self.either(tags) else { return Vec::new() };
        match set.child("objects") {
            Some(objects) => objects.children().collect(),
            None => set.children().filter(|child| child.tag() != "groups").collect(),
        }
    }

    /// True if it has a function of any kind. An empty `<function/>` does not count.
    pub fn has_function(&self) -> bool {
        let holds = |child: Element<'d>| child.tag() == "function" && child.children().next().is_some();
        self.children().any(|child| holds(child) || child.name() == "function")
    }

    /// The element itself and all elements below it, if they have this tag.
    pub fn descendants(&self, tag: &'static str) -> impl Iterator<Item = Element<'d>> + use<'d> {
        let file = self.file;
        self.node.descendants().filter(move |node| node.has_tag_name(tag)).map(move |node| Element { node, file })
    }

    /// Trimmed text of a child; `None` if absent or empty.
    pub fn text(&self, tag: &str) -> Option<&'d str> {
        self.child(tag)?.own_text()
    }

    /// Trimmed text of the element; `None` if empty.
    pub fn own_text(&self) -> Option<&'d str> {
        self.node.text().map(str::trim).filter(|text| !text.is_empty())
    }

    /// Boolean value of a child; `default` if absent.
    pub fn flag(&self, tag: &str, default: bool) -> bool {
        self.text(tag).map_or(default, |text| text.eq_ignore_ascii_case("true") || text == "1")
    }

    /// Numbers in a child; `None` if there are none.
    ///
    /// # Errors
    /// If one of them is not a finite number.
    pub fn numbers(&self, tag: &str) -> Result<Option<Vec<f64>>> {
        let Some(child) = self.child(tag) else { return Ok(None) };
        let number = |text: &str| {
            let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
            number.ok_or_else(|| child.error(format!("`{text}` is not a finite number"), "write a decimal number"))
        };
        let text = child.own_text().unwrap_or("").trim_matches(['(', ')']);
        let numbers: Vec<f64> = text
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|t| !t.is_empty())
            .map(number)
            .collect::<Result<_>>()?;
        Ok((!numbers.is_empty()).then_some(numbers))
    }

    /// The number in a child; `None` if absent.
    ///
    /// # Errors
    /// If the child does not hold exactly one number.
    pub fn number(&self, tag: &str) -> Result<Option<f64>> {
        Ok(self.vector::<1>(tag)?.map(|[x]| x))
    }

    /// The N numbers in a child; `None` if absent.
    ///
    /// # Errors
    /// If the child does not hold exactly N numbers.
    pub fn vector<const N: usize>(&self, tag: &str) -> Result<Option<[f64; N]>> {
        let Some(numbers) = self.numbers(tag)? else { return Ok(None) };
        let found = numbers.len();
        let wrong = || {
            self.error(
                format!("<{tag}> has {}", counted(found, "number")),
                &format!("expected {}", counted(N, "number")),
            )
        };
        numbers.try_into().map(Some).map_err(|_| wrong())
    }

    /// The name by which the element refers to another one: in a socket of version 4 (three spellings), or in a child
    /// with one of the tags `older`.
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
