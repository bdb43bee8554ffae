//! The add-on for Blender as a zip that Blender installs.

use std::io::{Cursor, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Files of `integrations/blender/` and their names in the zip: an extension is a package.
const FILES: [(&str, &str); 2] =
    [("blender_manifest.toml", "blender_manifest.toml"), ("dunkelfeld_export.py", "__init__.py")];

/// Writes `out/dunkelfeld-blender.zip`. The same sources give the same bytes.
pub(crate) fn run() -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("the folder of the workspace is missing")?;
    let folder = root.join("integrations/blender");
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (source, name) in FILES {
        let path = folder.join(source);
        let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        archive.start_file(name, options).map_err(|e| format!("{name}: {e}"))?;
        archive.write_all(&bytes).map_err(|e| format!("{name}: {e}"))?;
    }
    let bytes = archive.finish().map_err(|e| e.to_string())?.into_inner();
    let out = root.join("out");
    std::fs::create_dir_all(&out).map_err(|e| format!("{}: {e}", out.display()))?;
    let path = out.join("dunkelfeld-blender.zip");
    std::fs::write(&path, bytes).map_err(|e| format!("{}: {e}", path.display()))?;
    println!("wrote {}", path.display());
    Ok(())
}
