//! `retina schema`.

use std::path::PathBuf;

use retina_assets::SCHEMAS;
use retina_files::{InputError, nearest, write_atomic};

use crate::failure::Failure;
use crate::output::{print_lines, print_text, tell};

#[derive(clap::Args)]
#[command(arg_required_else_help = true)]
pub(crate) struct Arguments {
    /// Schema to print, such as `setup` or `scene`.
    #[arg(conflicts_with_all = ["list", "out"])]
    name: Option<String>,
    /// Print the names of all schemas, with what they are of.
    #[arg(long, conflicts_with = "out")]
    list: bool,
    /// Folder into which all schemas are written, each as NAME.schema.json.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(name) = &arguments.name {
        let names = || SCHEMAS.iter().map(|(name, _)| *name);
        let Some((_, text)) = SCHEMAS.iter().find(|(own, _)| own == name) else {
            let mut error = InputError::new("NAME", "there is no such schema")
                .found(format!("`{name}`"))
                .expected(format!("one of {}", names().collect::<Vec<_>>().join(", ")));
            if let Some(near) = nearest(name, names()) {
                error = error.help(format!("did you mean `{near}`?"));
            }
            return Err(error.into());
        };
        return print_text(text);
    }
    let Some(out) = &arguments.out else {
        let lines: Vec<String> =
            SCHEMAS.iter().map(|(name, text)| format!("{name:<24}{}", title(text))).collect();
        return print_lines(&lines);
    };
    let unwritten = |error: std::io::Error| InputError::new(out, format!("cannot be written: {error}"));
    std::fs::create_dir_all(out).map_err(unwritten)?;
    for (name, text) in SCHEMAS {
        write_atomic(&out.join(format!("{name}.schema.json")), text.as_bytes()).map_err(unwritten)?;
    }
    tell!("{} schemas are in {}", SCHEMAS.len(), out.display());
    Ok(())
}

/// What a schema is of.
fn title(text: &str) -> String {
    let schema: serde_json::Value = serde_json::from_str(text).unwrap_or_default();
    schema["title"].as_str().unwrap_or_default().to_owned()
}
