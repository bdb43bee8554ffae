//! The header is made, and programs in C and C++ are compiled with it by the compilers of the system and run, also under
//! valgrind. Replay: `cargo test --workspace --test it c_api::NAME -- --nocapture`.

#![allow(clippy::print_stdout, reason = "says which compiler or tool is not here")]

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tempfile::TempDir;

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");

const JOB: &str = "scene = 'none'\nfilm = { width = 24, height = 16 }\nbudget = { spp = 4 }\n\
    camera = { look_at = [0, 0, 0], position = [0.1, 0.2, 0.3] }\nenvironment = { radiance = 1 }\n\
    [[object]]\nkind = \"cylinder\"\nname = \"part\"\ndiameter = \"60mm\"\nheight = \"40mm\"\n\
    [[object]]\nkind = \"plane\"\nname = \"floor\"\nsize = [\"400mm\", \"400mm\"]\ntranslate = [0, \"-30mm\", 0]\n";

/// The folder of the programs, with `dunkelfeld.h` in it.
struct Workshop(TempDir);

impl Workshop {
    fn new() -> Self {
        let folder = TempDir::new().expect("a folder");
        header().write_to_file(folder.path().join("dunkelfeld.h"));
        fs::write(folder.path().join("job.toml"), JOB).expect("writable");
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Compiles a program; `None` if the system has no such compiler.
    fn compile(&self, compiler: &str, flags: &[&str], source: &Path) -> Option<PathBuf> {
        if Command::new(compiler).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
            println!("left out: {compiler} is not installed");
            return None;
        }
        let program = self.path(source.file_stem().expect("a name").to_str().expect("UTF-8"));
        let libraries = env::current_exe().expect("a program").parent().expect("a folder").to_path_buf();
        let mut command = Command::new(compiler);
        command.args(flags).args(["-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]);
        command.arg("-I").arg(self.0.path()).arg("-I").arg(Path::new(PACKAGE).join("include")).arg(source);
        command.arg("-L").arg(&libraries).args(["-ldunkelfeld_capi", "-pthread", "-o"]).arg(&program);
        command.arg(format!("-Wl,-rpath,{}", libraries.display()));
        let output = command.output().expect("a compiler");
        assert!(output.status.success(), "{command:?}\n{}", String::from_utf8_lossy(&output.stderr));
        Some(program)
    }

    fn c(&self, source: &str) -> PathBuf {
        // Rust itself links by this compiler.
        self.compile("cc", &["-std=c11"], &Path::new(PACKAGE).join(source)).expect("a compiler of C")
    }

    fn cpp(&self, source: &str) -> Option<PathBuf> {
        self.compile("c++", &["-std=c++17"], &Path::new(PACKAGE).join(source))
    }

    /// Runs a program in the folder, with its standard output.
    fn run(&self, program: &Path, arguments: &[&str]) -> String {
        self.finish(Command::new(program).args(arguments))
    }

    fn finish(&self, command: &mut Command) -> String {
        let output = command.current_dir(self.0.path()).output().expect("a program");
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{command:?}: {}\n{errors}", output.status);
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    /// Runs a program under valgrind: no invalid access, and no lost memory. Nothing if there is no valgrind.
    fn check_memory(&self, program: &Path, arguments: &[&str]) {
        if Command::new("valgrind").arg("--version").stdout(Stdio::null()).status().is_err() {
            println!("left out: valgrind is not installed");
            return;
        }
        let mut command = Command::new("valgrind");
        command.args([
            "--quiet",
            "--fair-sched=yes",
            "--error-exitcode=99",
            "--leak-check=full",
            "--errors-for-leak-kinds=definite",
        ]);
        self.finish(command.arg(program).args(arguments));
    }
}

fn header() -> cbindgen::Bindings {
    let package = Path::new(PACKAGE);
    let config = cbindgen::Config::from_file(package.join("cbindgen.toml")).expect("a configuration");
    cbindgen::Builder::new().with_config(config).with_src(package.join("src/lib.rs")).generate().expect("a header")
}

/// A change of this snapshot changes the binary interface. Functions and fields may be added; all else needs another
/// `ABI_VERSION`.
#[test]
fn the_interface_is_that_of_its_version() {
    let mut text = Vec::new();
    header().write(&mut text);
    let text = String::from_utf8(text).expect("UTF-8");
    let mut inside = false;
    let code = text.lines().filter(|line| {
        let comment = line.trim_start();
        inside |= comment.starts_with("/*");
        let is_code = !inside && !comment.is_empty();
        inside &= !comment.ends_with("*/");
        is_code
    });
    let code: Vec<&str> = code.collect();
    insta::assert_snapshot!("interface", code.join("\n"));
}

#[test]
fn the_version_for_cmake_is_that_of_the_package() {
    let file = Path::new(PACKAGE).join("cmake/dunkelfeld-config-version.cmake");
    let text = fs::read_to_string(file).expect("a file");
    assert!(text.contains(&format!("PACKAGE_VERSION \"{}\"", env!("CARGO_PKG_VERSION"))), "{text}");
}

#[test]
fn a_program_in_c_has_the_bits_of_the_facade() {
    let shop = Workshop::new();
    let words = shop.run(&shop.c("../../../examples/c/render.c"), &["job.toml", "out.pgm", "8"]);
    assert!(words.contains("hidden beneath the noise"), "{words}");
    let mut project = dunkelfeld::Project::open(shop.path("job.toml")).expect("a job");
    project.settings.budget = dunkelfeld::Budget::default().with_spp(8.0);
    let dunkelfeld::Picture::Gray(plane) = project.render().expect("rendered").frame.picture else {
        panic!("the default sensor is monochrome")
    };
    let picture = fs::read(shop.path("out.pgm")).expect("a picture");
    assert_eq!(picture.strip_prefix(b"P5\n24 16\n255\n".as_slice()).expect("a header"), plane.data());
}

#[test]
fn bad_input_is_a_status() {
    let shop = Workshop::new();
    assert_eq!(shop.run(&shop.c("tests/bad_input.c"), &["job.toml"]).trim(), "all statuses are as expected");
}

#[test]
fn programs_in_cpp_run() {
    let shop = Workshop::new();
    let Some(poses) = shop.cpp("../../../examples/cpp/poses.cpp") else { return };
    assert_eq!(shop.run(&poses, &["job.toml", "part", "3"]).lines().count(), 3);
    let raii = shop.cpp("tests/raii.cpp").expect("a compiler of C++");
    assert_eq!(shop.run(&raii, &["job.toml"]).trim(), "all checks hold");
}

#[test]
#[ignore = "slow: valgrind"]
fn no_memory_is_lost_or_read_beyond_its_end() {
    let shop = Workshop::new();
    shop.check_memory(&shop.c("../../../examples/c/render.c"), &["job.toml", "out.pgm", "2"]);
    shop.check_memory(&shop.c("tests/bad_input.c"), &["job.toml", "few"]);
    if let Some(raii) = shop.cpp("tests/raii.cpp") {
        shop.check_memory(&raii, &["job.toml"]);
    }
}
