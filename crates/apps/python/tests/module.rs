//! The module of Python exists after a build. The tests of the package are in Python, beside this file; `.ci/run` runs them.

#[test]
fn the_module_is_beside_the_tests() {
    let tests = std::env::current_exe().expect("a program");
    let module =
        tests.with_file_name(format!("{}_native{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX));
    let length = module.metadata().unwrap_or_else(|e| panic!("{}: {e}", module.display())).len();
    assert!(length > 1 << 20, "{length} bytes");
}
