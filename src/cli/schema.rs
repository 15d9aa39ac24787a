//! `sinew schema`: prints the JSON Schema of study and model files, or their keys with explanations.

use super::arguments::{Format, Look, SchemaKind};
use super::output::print_table;
use super::{GOOD, print};
use crate::error::Result;
use crate::reference::{self, FileKind};

pub fn schema(kind: SchemaKind, keys: bool) -> Result<u8> {
    let kind = match kind {
        SchemaKind::Study => FileKind::Study,
        SchemaKind::Model => FileKind::PlanarModel,
        SchemaKind::SpatialModel => FileKind::SpatialModel,
    };
    if keys {
        let look = Look { wide: true, format: Format::Markdown };
        print_table(&reference::table(&reference::keys(kind), true), look)?;
    } else {
        print(&format!("{:#}", reference::schema(kind)));
    }
    Ok(GOOD)
}
