//! Embeds all TOML files below `profiles/` as (path, text, compiled), and the rows of the conclusions compiled. The
//! compiled form saves parsing at each program start. `src/profile/compiled.rs` describes and reads it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

#[expect(clippy::disallowed_methods, reason = "a build script has only its environment")]
fn main() -> io::Result<()> {
    let manifest = PathBuf::from(env::var("CARGO_MANIFEST_DIR").map_err(io::Error::other)?);
    let root = manifest.join("profiles");
    let out = PathBuf::from(env::var("OUT_DIR").map_err(io::Error::other)?);
    let mut files = Vec::new();
    collect(&root, &mut files)?;
    files.sort();
    let mut table = String::from("pub(super) const FILES: &[(&str, &str, &str)] = &[\n");
    for (place, file) in files.iter().enumerate() {
        let path = file.strip_prefix(&root).map_err(io::Error::other)?;
        let name = path.to_string_lossy().replace('\\', "/");
        let compiled = out.join(format!("profile_{place}"));
        fs::write(&compiled, compile(file)?)?;
        let [text, compiled] = [file, &compiled].map(|path| path.display().to_string());
        writeln!(table, "    ({name:?}, include_str!({text:?}), include_str!({compiled:?})),")
            .map_err(io::Error::other)?;
    }
    table.push_str("];\n");
    fs::write(out.join("profiles.rs"), table)?;
    let hypotheses = manifest.join("src/conclusion/hypotheses.toml");
    println!("cargo::rerun-if-changed={}", hypotheses.display());
    fs::write(out.join("hypotheses"), compile(&hypotheses)?)?;
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
fn compile(file: &Path) -> io::Result<String> {
    let text = fs::read_to_string(file)?;
    let wrong = |error: String| io::Error::other(format!("{}: {error}", file.display()));
    let table = DeTable::parse(&text).map_err(|error| wrong(error.to_string()))?;
    let mut out = String::new();
    let span = table.span();
    put(&Spanned::new(span, DeValue::Table(table.into_inner())), &mut out).map_err(wrong)?;
    Ok(out)
}

/// Appends a value in the compiled form.
fn put(value: &Spanned<DeValue<'_>>, out: &mut String) -> Result<(), String> {
    let mut content = String::new();
    let tag = match value.get_ref() {
        DeValue::String(text) => {
            content.push_str(text);
            's'
        }
        DeValue::Integer(number) => {
            let number = i64::from_str_radix(number.as_str(), number.radix());
            put_number(
                number.map_err(|error| error.to_string())?.cast_unsigned().rotate_left(1),
                &mut content,
            );
            'i'
        }
        DeValue::Float(number) => {
            let number: f64 = number.as_str().parse().map_err(|error| format!("{error}"))?;
            put_number(number.to_bits().swap_bytes(), &mut content);
            'f'
        }
        DeValue::Boolean(is_true) => {
            put_number((*is_true).into(), &mut content);
            'b'
        }
        DeValue::Array(values) => {
            put_number(values.len() as u64, &mut content);
            for value in values {
                put(value, &mut content)?;
            }
            'a'
        }
        DeValue::Table(table) => {
            for (key, value) in table {
                put_number(key.get_ref().len() as u64, &mut content);
                content.push_str(key.get_ref());
                put(value, &mut content)?;
            }
            't'
        }
        DeValue::Datetime(_) => return Err("dates are not supported".into()),
    };
    let span = value.span();
    out.push(tag);
    put_place(span.start, out)?;
    put_place(span.end - span.start, out)?;
    put_number(content.len() as u64, out);
    out.push_str(&content);
    Ok(())
}

/// Appends a position or length in the text: three characters of six bits, the lowest first.
fn put_place(number: usize, out: &mut String) -> Result<(), String> {
    if number >= 1 << 18 {
        return Err("the file is too long".into());
    }
    for shift in [0, 6, 12] {
        out.push(char::from((number >> shift & 0x3F).to_le_bytes()[0]));
    }
    Ok(())
}

/// Appends a number in groups of six bits, the lowest first; bit 6 of a character marks that more characters
/// follow.
fn put_number(mut number: u64, out: &mut String) {
    while number > 0x3F {
        out.push(char::from(0x40 | number.to_le_bytes()[0] & 0x3F));
        number >>= 6;
    }
    out.push(char::from(number.to_le_bytes()[0]));
}
