//! Import cycles: no more than three files of a crate may depend on each other in a cycle.
//!
//! A node is a file below `src/`. An edge leads from a file to the file that defines a name which the first one reaches by
//! a path (`use crate::a::B`, `super::f()`, `child::g()`). Names are followed through re-exports to their definition. A
//! re-export alone is no edge, because nothing is computed with the name; an import of a module is none either, but each
//! path that goes through it is. Code behind `#[cfg(test)]` does not count. Strongly connected components are found by
//! the algorithm of Tarjan (1972).

use std::collections::{BTreeMap, BTreeSet};

use super::module_tree::{ModuleTree, Target};

/// Files that may depend on each other in one cycle.
const MAX_FILES: usize = 3;

/// The edges of one crate: file, file it uses, names for which it does.
type Edges = BTreeMap<usize, BTreeMap<usize, BTreeSet<String>>>;

/// The faults of one crate, called `name` in messages. `files` has the paths below its `src/`, with forward slashes, and
/// their texts.
pub(crate) fn check(name: &str, files: &[(String, String)]) -> Vec<String> {
    let tree = ModuleTree::read(files);
    let edges = edges(&tree);
    let neighbours: Vec<Vec<usize>> =
        (0..files.len()).map(|f| edges.get(&f).map_or_else(Vec::new, |to| to.keys().copied().collect())).collect();
    let file = |f: usize| files[f].0.as_str();
    let mut faults = Vec::new();
    for component in components(&neighbours).into_iter().filter(|c| c.len() > MAX_FILES) {
        let names: Vec<&str> = component.iter().map(|&f| file(f)).collect();
        let mut fault = format!(
            "{name}/src: an import cycle of {} files, at most {MAX_FILES} are allowed: {}",
            names.len(),
            names.join(", ")
        );
        for &from in &component {
            for (to, reasons) in edges.get(&from).into_iter().flatten().filter(|(to, _)| component.contains(to)) {
                let reasons: Vec<&str> = reasons.iter().map(String::as_str).collect();
                fault.push_str(&format!("\n  {} uses {} for {}", file(from), file(*to), reasons.join(", ")));
            }
        }
        faults.push(fault);
    }
    faults
}

fn edges(tree: &ModuleTree) -> Edges {
    let mut edges = Edges::new();
    for module in tree.modules() {
        // A trait may be imported and not named again. Names that come by `*` or by a re-export count where they are used.
        let imports = module.imports.iter().filter(|i| !i.is_reexport && i.name != "*").map(|i| i.path.as_slice());
        let paths = module.paths.iter().map(Vec::as_slice);
        let words = module.words.iter().map(std::slice::from_ref);
        for path in imports.chain(paths).chain(words) {
            if let Target::Item { file, name } = tree.resolve(module, path)
                && file != module.file
            {
                edges.entry(module.file).or_default().entry(file).or_default().insert(name);
            }
        }
    }
    edges
}

/// The strongly connected components of a graph, each sorted, by their smallest node.
fn components(neighbours: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut search =
        Search { neighbours, index: vec![None; neighbours.len()], low: vec![0; neighbours.len()], ..Search::default() };
    for node in 0..neighbours.len() {
        if search.index[node].is_none() {
            search.visit(node);
        }
    }
    search.found.sort();
    search.found
}

/// The state of Tarjan's depth-first search.
#[derive(Default)]
struct Search<'a> {
    neighbours: &'a [Vec<usize>],
    /// Order of discovery.
    index: Vec<Option<usize>>,
    /// Smallest index that is reachable through the stack so far.
    low: Vec<usize>,
    stack: Vec<usize>,
    visited: usize,
    found: Vec<Vec<usize>>,
}

impl Search<'_> {
    /// Depth is at most the number of files of a crate.
    fn visit(&mut self, node: usize) {
        let index = self.visited;
        self.visited += 1;
        (self.index[node], self.low[node]) = (Some(index), index);
        self.stack.push(node);
        for &next in &self.neighbours[node] {
            match self.index[next] {
                None => {
                    self.visit(next);
                    self.low[node] = self.low[node].min(self.low[next]);
                }
                Some(other) if self.stack.contains(&next) => self.low[node] = self.low[node].min(other),
                Some(_) => {}
            }
        }
        if self.low[node] == index {
            let start = self.stack.iter().position(|&n| n == node).unwrap_or(0);
            let mut component = self.stack.split_off(start);
            component.sort_unstable();
            self.found.push(component);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(files: &[(&str, &str)]) -> Vec<String> {
        let files: Vec<_> = files.iter().map(|&(path, text)| (path.to_owned(), text.to_owned())).collect();
        check("crates/x", &files)
    }

    const ROOT: (&str, &str) = ("lib.rs", "mod a;\nmod b;\nmod c;\nmod d;\npub use a::A;\npub use d::D;\n");

    /// Four files, of which each uses the next one; the last one has the text `last`.
    fn chain(last: &str) -> Vec<String> {
        faults(&[
            ROOT,
            ("a.rs", "use crate::b::{self, B};\npub struct A;\n"),
            ("b.rs", "pub struct B;\nfn f() { super::c::g() }\n"),
            ("c/mod.rs", "use crate::D;\npub fn g() {}\n"),
            ("d.rs", last),
        ])
    }

    #[test]
    fn a_cycle_of_four_files_is_a_fault_that_names_them_and_their_edges() {
        let found = chain("pub struct D { a: crate::A }\n");
        assert_eq!(
            found,
            ["crates/x/src: an import cycle of 4 files, at most 3 are allowed: a.rs, b.rs, c/mod.rs, d.rs\n  \
              a.rs uses b.rs for B\n  b.rs uses c/mod.rs for g\n  c/mod.rs uses d.rs for D\n  d.rs uses a.rs for A"]
        );
    }

    #[test]
    fn every_way_to_write_the_closing_path_is_found() {
        for last in [
            "use crate::a::A;\npub struct D(A);\n",
            "use super::{a::{A as Other}, c};\npub struct D(Other);\n",
            "use crate::a;\npub struct D(a::A);\n",
            "use crate::{a as first};\npub struct D(first::A);\n",
            "use crate::a::*;\npub struct D(A);\n",
            "use super::*;\npub struct D;\nfn f() { let _ = A; }\n",
            "pub use crate::a::A;\npub struct D(A);\n",
            "pub struct D;\nmod inner {\n    use super::super::a::A;\n}\n",
            "pub struct D;\nfn f() {\n    use crate::A;\n}\n",
            "#[cfg(any(test, unix))]\nuse crate::A;\npub struct D;\n",
            "#[cfg(not(test))]\nuse crate::A;\npub struct D;\n",
        ] {
            assert_eq!(chain(last).len(), 1, "{last}");
        }
    }

    #[test]
    fn chains_tests_comments_and_reexports_are_no_cycle() {
        for last in [
            "pub struct D;\n",
            "//! Like crate::a::A.\n/// crate::a::A\npub struct D;\nconst S: &str = \"crate::a::A\";\n",
            "pub struct D;\n#[cfg(test)]\nmod tests {\n    use crate::a::A;\n    fn f() { if true {} }\n}\n",
            "pub struct D;\n#[cfg(test)]\nuse crate::a::A;\n",
            "pub struct D;\n#[cfg(test)]\n#[allow(unused)]\nfn f(x: [u8; 2]) -> crate::A { crate::A }\n",
            "#![cfg(test)]\nuse crate::a::A;\npub struct D;\n",
            "pub use crate::a::A;\npub struct D;\n",
            "use crate::a;\npub struct D;\n",
            "use other::a::A;\npub struct D(std::a::A);\n",
        ] {
            assert_eq!(chain(last), Vec::<String>::new(), "{last}");
        }
    }

    #[test]
    fn cycles_of_two_and_three_files_are_allowed() {
        let two = [
            ("lib.rs", "mod a;\nmod b;\n"),
            ("a.rs", "use crate::b::B;\npub struct A;\n"),
            ("b.rs", "use crate::a::A;\npub struct B;\n"),
        ];
        assert_eq!(faults(&two), Vec::<String>::new());
        let three = [
            ("main.rs", "mod a;\nmod b;\nmod c;\nuse a::A;\nfn main() {}\n"),
            ("a.rs", "use crate::b::B;\npub struct A;\n"),
            ("b.rs", "use crate::c::C;\npub struct B;\n"),
            ("c.rs", "use crate::a::A;\npub struct C;\n"),
        ];
        assert_eq!(faults(&three), Vec::<String>::new());
    }

    #[test]
    fn files_for_tests_alone_do_not_count() {
        let shared = [("a.rs", "use crate::b::B;\npub struct A;\n"), ("b.rs", "use crate::c::C;\npub struct B;\n")];
        let behind_tests = [
            ("lib.rs", "mod a;\nmod b;\nmod c;\n#[cfg(test)]\nmod d;\n"),
            shared[0],
            shared[1],
            ("c.rs", "pub struct C;\nuse crate::d::D;\n"),
            ("d.rs", "use crate::a::A;\npub struct D;\n"),
        ];
        assert_eq!(faults(&behind_tests), Vec::<String>::new());
        let always = [("lib.rs", "mod a;\nmod b;\nmod c;\nmod d;\n")].into_iter().chain(behind_tests[1..].to_vec());
        assert_eq!(faults(&always.collect::<Vec<_>>()).len(), 1);
        let by_name = [
            ("lib.rs", "mod a;\nmod b;\nmod c;\n"),
            shared[0],
            shared[1],
            ("c.rs", "pub struct C;\n#[cfg(test)]\n#[path = \"c_tests.rs\"]\nmod tests;\n"),
            ("c_tests.rs", "use crate::a::A;\n"),
        ];
        assert_eq!(faults(&by_name), Vec::<String>::new());
    }

    #[test]
    fn components_are_those_of_the_graph() {
        // Two cycles that share no node, an edge between them, and a node alone.
        let graph = [vec![1], vec![2], vec![0, 3], vec![4], vec![3], vec![0]];
        assert_eq!(components(&graph), [vec![0, 1, 2], vec![3, 4], vec![5]]);
        // Two cycles through one node are one component.
        assert_eq!(components(&[vec![1, 2], vec![0], vec![0]]), [vec![0, 1, 2]]);
        assert_eq!(components(&[vec![0]]), [vec![0]]);
        assert!(components(&[]).is_empty());
    }
}
