//! Rules for the names of bodies, muscles, coordinates and ratios. Names appear in table cells, on the terminal and as
//! labels in figures.

/// Greatest length of a name, in characters.
const MAX_LENGTH: usize = 200;

/// What is wrong with a name, if it cannot be used safely in files, web pages and spreadsheets.
pub fn defect(name: &str) -> Option<String> {
    if name.is_empty() {
        return Some("it is empty".to_owned());
    }
    let length = name.chars().count();
    if length > MAX_LENGTH {
        return Some(format!("it has {length} characters; at most {MAX_LENGTH} are allowed"));
    }
    if crate::terminal::visible(name) != name || name.contains(['\n', '\t']) {
        return Some("it contains a line break or another control character".to_owned());
    }
    is_formula(name).then(|| format!("it begins with `{}`, so spreadsheets would read it as a formula", &name[..1]))
}

/// Whether spreadsheets would read a cell with this text as a formula.
pub fn is_formula(text: &str) -> bool {
    text.starts_with(['=', '+', '-', '@', '\t', '\r'])
}

/// A number of things: `1 job`, `12 jobs`.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// A name as shown in a message: on one line, and truncated if it is very long.
pub fn shown(name: &str) -> String {
    let name = name.replace('\n', "␊").replace('\t', "␉");
    match name.char_indices().nth(MAX_LENGTH / 4) {
        None => name,
        Some((end, _)) => format!("{}…", &name[..end]),
    }
}

/// An enumeration of words, as files and studies write them.
macro_rules! choices {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $text:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        pub enum $name { $($(#[$variant_doc])* #[serde(rename = $text)] $variant),+ }

        impl $name {
            pub const VARIANTS: &'static [Self] = &[$($name::$variant),+];
            pub const ALL: &'static [&'static str] = &[$($text),+];

            pub fn parse(text: &str) -> Option<Self> {
                Self::VARIANTS.iter().copied().find(|own| own.name() == text)
            }

            pub fn name(self) -> &'static str {
                match self { $($name::$variant => $text),+ }
            }
        }
    };
}

/// The default of each of these.
macro_rules! defaults {
    ($($name:ident::$variant:ident),+ $(,)?) => {
        $(impl Default for $name {
            fn default() -> Self {
                Self::$variant
            }
        })+
    };
}
pub(crate) use {choices, defaults};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unsafe_names_are_rejected() {
        for good in ["biceps", "Adductor longus (left)", "a<b>&\"c\"", "M. biceps_2", "μ-fibre", "1st"] {
            assert_eq!(defect(good), None, "{good}");
        }
        let long = "x".repeat(201);
        for bad in ["", "a\nb", "a\tb", "\u{1b}[31m", "\u{202e}a", "=1+1", "+a", "-a", "@a", &long] {
            assert!(defect(bad).is_some(), "{bad}");
        }
        assert_eq!(shown(&long).chars().count(), 51);
        assert_eq!(shown("a\nb"), "a␊b");
    }
}
