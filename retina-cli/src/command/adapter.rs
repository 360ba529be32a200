//! `retina adapter`.

use retina_batch::AdapterName;
use serde_json::json;

use super::Backend;
use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Renderer to check, as in `retina render`.
    #[arg(long, value_enum, default_value_t)]
    backend: Backend,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let (name, fallback) = AdapterName::of_choice(arguments.backend.into())?;
    let reason = fallback.map(|error| error.to_string());
    if arguments.json {
        print_json(&json!({
            "schema": "retina.adapter/1",
            "backend": name.backend,
            "adapter": name.adapter,
            "driver": name.driver,
            "fallback_reason": reason,
        }))?;
        return Ok(());
    }
    print_lines(&[format!("{}: {} ({})", name.backend, name.adapter, name.driver)])?;
    if let Some(reason) = reason {
        tell!("rendering would use the processor: {reason}");
    }
    Ok(())
}
