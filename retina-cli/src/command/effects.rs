//! `retina effects`.

use std::path::PathBuf;

use retina_diagnosis::{effects, effects_json, effects_page, effects_text};
use retina_files::{InputError, nearest};
use retina_formats::TableKind;

use crate::failure::Failure;
use crate::output::{print_json, print_lines};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// An effect's id; without one all are listed.
    effect: Option<String>,
    /// Effects on one table alone.
    #[arg(long, value_enum)]
    table: Option<Table>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
    /// Write a page with what each looks like.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Table {
    Points,
    Power,
    Phase,
    Frames,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let kind = arguments.table.map(|table| match table {
        Table::Points => TableKind::Points,
        Table::Power => TableKind::Power,
        Table::Phase => TableKind::Phase,
        Table::Frames => TableKind::Frames,
    });
    let mut list = effects(kind);
    if let Some(id) = &arguments.effect {
        let ids: Vec<&str> = list.iter().map(|effect| effect.name()).collect();
        if !ids.contains(&id.as_str()) {
            let error = InputError::new("EFFECT", "is no effect of the catalogue").found(format!("`{id}`"));
            let near = nearest(id, ids.iter().copied());
            return Err(match near {
                Some(near) => error.help(format!("did you mean `{near}`?")),
                None => error.expected(ids.join(", ")),
            }
            .into());
        }
        list.retain(|effect| effect.name() == id);
    }
    if let Some(path) = &arguments.report {
        crate::check_file(path, "html")?;
        effects_page(&list)?.write(path)?;
    }
    match arguments.json {
        true => print_json(&effects_json(&list)),
        false => print_lines(&effects_text(&list)),
    }
}
