//! Meta-kernels: text kernels that name others (NAIF, Kernel Required Reading, "Meta-kernels").

use std::path::{Path, PathBuf};

use retina_files::InputError;

use super::text::Pool;

const LIST: &str = "KERNELS_TO_LOAD";
/// Most kernels that one may name: SPICE itself holds 5300 files.
const MOST_KERNELS: usize = 5300;

/// The kernels that a text kernel's pool names, in their order; `None` where it names none.
///
/// A relative path starts at the folder of the meta-kernel, as all paths in files do here.
///
/// # Errors
/// The list or its symbols do not fit.
pub(super) fn named_kernels(path: &Path, own: &Pool) -> Result<Option<Vec<PathBuf>>, InputError> {
    let Some(list) = own.texts(LIST)? else { return Ok(None) };
    let list = joined(own, LIST, &list)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let symbols = own.texts("PATH_SYMBOLS")?.unwrap_or_default();
    let values = match own.texts("PATH_VALUES")? {
        Some(values) => joined(own, "PATH_VALUES", &values)?,
        None => Vec::new(),
    };
    if symbols.len() != values.len() {
        return Err(InputError::new(path, "PATH_SYMBOLS and PATH_VALUES do not go together")
            .found(format!("{} symbols and {} values", symbols.len(), values.len()))
            .expected("one value for each symbol"));
    }
    if list.len() > MOST_KERNELS {
        return Err(InputError::new(path, "the meta-kernel names too many kernels")
            .at(LIST)
            .found(list.len())
            .expected(format!("{MOST_KERNELS} at most")));
    }
    let mut replaced: Vec<(&str, &String)> = symbols.into_iter().map(str::trim).zip(&values).collect();
    // A symbol may begin with another one.
    replaced.sort_by_key(|(symbol, _)| std::cmp::Reverse(symbol.len()));
    let mut found = Vec::new();
    for entry in &list {
        let mut name = entry.trim().to_owned();
        if let Some(at) = name.find('$') {
            let after = &name[at + 1..];
            let Some((symbol, value)) = replaced.iter().find(|(symbol, _)| after.starts_with(symbol)) else {
                let known: Vec<String> = replaced.iter().map(|(symbol, _)| format!("${symbol}")).collect();
                return Err(InputError::new(path, "a path has an unknown symbol")
                    .at(LIST)
                    .found(entry)
                    .expected(if known.is_empty() {
                        "a path without `$`, or symbols in PATH_SYMBOLS".to_owned()
                    } else {
                        format!("one of {}", known.join(", "))
                    }));
            };
            name.replace_range(at..at + 1 + symbol.len(), value.trim());
        }
        found.push(folder.join(name));
    }
    Ok(Some(found))
}

/// Texts of which one that ends in `+` goes on in the next.
fn joined(pool: &Pool, name: &str, texts: &[&str]) -> Result<Vec<String>, InputError> {
    let (mut whole, mut open) = (Vec::new(), String::new());
    for text in texts {
        match text.trim_end().strip_suffix('+') {
            Some(part) => open.push_str(part),
            None => whole.push(std::mem::take(&mut open) + text),
        }
    }
    if open.is_empty() {
        return Ok(whole);
    }
    Err(pool.variables[name]
        .error(name, "the last text ends in `+` and nothing follows")
        .found(open)
        .expected("the rest of the path in a further text"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(data: &str) -> Result<Option<Vec<PathBuf>>, String> {
        let (path, mut pool) = (Path::new("mk/all.tm"), Pool::default());
        pool.read(path, format!("KPL/MK\n\\begindata\n{data}").as_bytes()).unwrap();
        named_kernels(path, &pool).map_err(|error| error.to_string())
    }

    #[test]
    fn symbols_and_continued_paths_are_put_together() {
        let found = named(
            "PATH_VALUES = ( '/data/a+' '/b' '..' )\nPATH_SYMBOLS = ( 'K' 'KERNELS' )\n\
             KERNELS_TO_LOAD = ( '$KERNELS/spk/de440s.bsp', 'pck+'\n'00011+  ' '.tpc' '$K/x.tls' '/y.tf' )",
        );
        let expected =
            ["mk/../spk/de440s.bsp", "mk/pck00011.tpc", "/data/a/b/x.tls", "/y.tf"].map(PathBuf::from);
        assert_eq!(found, Ok(Some(expected.to_vec())));
        assert_eq!(named("A = 3"), Ok(None));
    }

    #[test]
    fn lists_that_do_not_fit_are_refused() {
        for (data, said) in [
            ("KERNELS_TO_LOAD = 3", "a value is no text"),
            ("KERNELS_TO_LOAD = '$A/x'", "unknown symbol (found $A/x, expected a path without `$`"),
            ("PATH_SYMBOLS = 'B' PATH_VALUES = 'b' KERNELS_TO_LOAD = '$A/x'", "expected one of $B"),
            ("PATH_SYMBOLS = 'B' KERNELS_TO_LOAD = '$B/x'", "found 1 symbols and 0 values"),
            ("KERNELS_TO_LOAD = ( 'x+' )", "ends in `+` and nothing follows (found x"),
        ] {
            let error = named(data).unwrap_err();
            assert!(error.contains(said), "{data}: {error}");
        }
    }
}
