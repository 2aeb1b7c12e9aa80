//! Names the sources that the extension is built from, so that a job notices that it goes on with others.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    reason = "a build script reads files, and prints what cargo is to know"
)]

use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Sources whose change may change a number, relative to this package.
const SOURCES: [&str; 3] = ["../impasto/src", "../impasto-gpu/src", "src"];

fn main() -> io::Result<()> {
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let mut hash = Fnv1a::default();
    for source in SOURCES {
        let folder = here.join(source);
        println!("cargo::rerun-if-changed={}", folder.display());
        // An archive of an extension without a renderer for graphics cards has no sources of it.
        for file in if folder.is_dir() { files(&folder)? } else { Vec::new() } {
            // The same on every system, wherever the sources lie.
            let name = file.strip_prefix(&folder).unwrap_or(&file);
            for part in name.components() {
                hash.add(part.as_os_str().as_encoded_bytes());
                hash.add(b"/");
            }
            hash.add(&fs::read(&file)?);
        }
    }
    println!("cargo::rustc-env=IMPASTO_SOURCES={:016x}", hash.0);
    Ok(())
}

/// The sources below a folder, in the order of their names; no file that an editor or a system leaves.
fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut entries =
        fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    entries.sort();
    let mut found = Vec::new();
    for path in entries {
        let hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        let source = path.extension().is_some_and(|ending| ending == "rs" || ending == "wgsl");
        if path.is_dir() {
            found.extend(files(&path)?);
        } else if source && !hidden {
            found.push(path);
        }
    }
    Ok(found)
}

/// The hash of Fowler, Noll and Vo (FNV-1a): it tells apart what differs by chance, not by intent.
struct Fnv1a(u64);

impl Default for Fnv1a {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv1a {
    fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}
