//! Embeds all TOML files below `profiles/` as (path, text, compiled). The compiled form saves parsing at each
//! program start. `src/profile/compiled.rs` describes and reads it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

#[expect(clippy::disallowed_methods, reason = "a build script has only its environment")]
fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").map_err(io::Error::other)?).join("profiles");
    let out = PathBuf::from(env::var("OUT_DIR").map_err(io::Error::other)?);
    let mut files = Vec::new();
    collect(&root, &mut files)?;
    files.sort();
    let mut table = String::from("pub(super) const FILES: &[(&str, &str, &[u8])] = &[\n");
    for (place, file) in files.iter().enumerate() {
        let path = file.strip_prefix(&root).map_err(io::Error::other)?;
        let name = path.to_string_lossy().replace('\\', "/");
        let compiled = out.join(format!("profile_{place}"));
        fs::write(&compiled, compile(file)?)?;
        let [text, compiled] = [file, &compiled].map(|path| path.display().to_string());
        writeln!(table, "    ({name:?}, include_str!({text:?}), include_bytes!({compiled:?})),")
            .map_err(io::Error::other)?;
    }
    table.push_str("];\n");
    fs::write(out.join("profiles.rs"), table)?;
    println!("cargo::rerun-if-changed={}", root.display());
    Ok(())
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    println!("cargo::rerun-if-changed={}", folder.display());
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|extension| extension == "toml") && !is_statements(&path) {
            files.push(path);
        }
    }
    Ok(())
}

/// Statements of a manual are the source of a document and unused by the program.
fn is_statements(path: &Path) -> bool {
    path.file_stem().is_some_and(|stem| stem.to_string_lossy().ends_with(".statements"))
}

#[expect(clippy::disallowed_methods, reason = "a build script reads what it embeds")]
fn compile(file: &Path) -> io::Result<Vec<u8>> {
    let text = fs::read_to_string(file)?;
    let wrong = |error: String| io::Error::other(format!("{}: {error}", file.display()));
    let table = DeTable::parse(&text).map_err(|error| wrong(error.to_string()))?;
    let mut out = Vec::new();
    let span = table.span();
    put(&Spanned::new(span, DeValue::Table(table.into_inner())), &mut out).map_err(wrong)?;
    Ok(out)
}

/// Appends a value in the compiled form.
fn put(value: &Spanned<DeValue<'_>>, out: &mut Vec<u8>) -> Result<(), String> {
    let mut content = Vec::new();
    let tag = match value.get_ref() {
        DeValue::String(text) => {
            content.extend_from_slice(text.as_bytes());
            b's'
        }
        DeValue::Integer(number) => {
            let number = i64::from_str_radix(number.as_str(), number.radix());
            content.extend(number.map_err(|error| error.to_string())?.to_le_bytes());
            b'i'
        }
        DeValue::Float(number) => {
            let number: f64 = number.as_str().parse().map_err(|error| format!("{error}"))?;
            content.extend(number.to_le_bytes());
            b'f'
        }
        DeValue::Boolean(is_true) => {
            content.push(u8::from(*is_true));
            b'b'
        }
        DeValue::Array(values) => {
            for value in values {
                put(value, &mut content)?;
            }
            b'a'
        }
        DeValue::Table(table) => {
            for (key, value) in table {
                put_number(key.get_ref().len(), &mut content);
                content.extend_from_slice(key.get_ref().as_bytes());
                put(value, &mut content)?;
            }
            b't'
        }
        DeValue::Datetime(_) => return Err("dates are not supported".into()),
    };
    let span = value.span();
    out.push(tag);
    put_number(span.start, out);
    put_number(span.end - span.start, out);
    put_number(content.len(), out);
    out.append(&mut content);
    Ok(())
}

/// Appends a number in groups of seven bits, the lowest first; the top bit of a byte marks that more bytes
/// follow.
fn put_number(mut number: usize, out: &mut Vec<u8>) {
    while number > 0x7F {
        out.push(0x80 | number.to_le_bytes()[0]);
        number >>= 7;
    }
    out.push(number.to_le_bytes()[0]);
}
