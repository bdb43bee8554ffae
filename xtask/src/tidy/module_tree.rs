//! The modules of a crate as far as import cycles need them: what each file defines, imports and names by a path.

use std::collections::BTreeSet;

use super::sources::without_comments_and_strings;

/// Re-exports that are followed from a name to its definition; a longer chain is taken as a cycle of re-exports.
const MAX_REEXPORTS: usize = 16;

/// One import: `use PATH as NAME`, one for each leaf of a group.
#[derive(Debug)]
pub(super) struct Import {
    pub(super) path: Vec<String>,
    /// The name in this module; `*` for all names of a module.
    pub(super) name: String,
    pub(super) is_reexport: bool,
}

/// A module, in a file of its own or within one.
#[derive(Debug, Default)]
pub(super) struct Module {
    /// Names from the root of the crate, which has none.
    path: Vec<String>,
    /// Position of the file in the list.
    pub(super) file: usize,
    /// Names that are defined here.
    items: BTreeSet<String>,
    pub(super) imports: Vec<Import>,
    /// Paths of at least two names in code other than imports.
    pub(super) paths: Vec<Vec<String>>,
    /// Words of code other than imports; of a path the first one.
    pub(super) words: BTreeSet<String>,
}

/// The target of a path.
#[derive(Debug, PartialEq)]
pub(super) enum Target {
    Item {
        file: usize,
        name: String,
    },
    Module(Vec<String>),
    /// Of another crate, or a local name.
    Elsewhere,
}

/// All modules of a crate that are compiled without tests.
#[derive(Debug)]
pub(super) struct ModuleTree {
    modules: Vec<Module>,
}

impl ModuleTree {
    /// Reads files by their paths below `src/`.
    pub(super) fn read(files: &[(String, String)]) -> Self {
        let mut modules = Vec::new();
        let mut tests_only = Vec::new();
        for (file, (path, text)) in files.iter().enumerate() {
            let Some(path) = module_path(path) else { continue };
            let tokens = tokens(&without_comments_and_strings(text));
            if starts_with(&tokens, &["#", "!", "[", "cfg", "(", "test", ")", "]"]) {
                continue;
            }
            let mut reader =
                Reader { file, tokens: &tokens, at: 0, modules: &mut modules, tests_only: &mut tests_only };
            reader.module(path);
        }
        modules.retain(|m: &Module| !tests_only.iter().any(|path| m.path.starts_with(path)));
        Self { modules }
    }

    pub(super) fn modules(&self) -> &[Module] {
        &self.modules
    }

    /// The target of the path in that module.
    pub(super) fn resolve(&self, module: &Module, path: &[String]) -> Target {
        self.resolve_within(module, path, MAX_REEXPORTS)
    }

    fn find(&self, path: &[String]) -> Option<&Module> {
        self.modules.iter().find(|m| m.path == path)
    }

    fn resolve_within(&self, module: &Module, path: &[String], reexports: usize) -> Target {
        let mut here = module.path.clone();
        let mut rest = path;
        let mut is_relative = true;
        while let Some((first, others)) = rest.split_first() {
            match first.as_str() {
                "crate" => here.clear(),
                "self" => {}
                "super" => drop(here.pop()),
                _ => break,
            }
            (rest, is_relative) = (others, false);
        }
        let mut owner = self.find(&here);
        while let (Some(found), Some((first, others))) = (owner, rest.split_first()) {
            here.push(first.clone());
            let child = self.find(&here);
            if child.is_none() {
                let target = self.resolve_name(found, first, others, reexports);
                return match target {
                    // A first name without a definition is that of another crate or of something local.
                    None if is_relative => Target::Elsewhere,
                    None if first == "*" => Target::Item { file: found.file, name: "*".to_owned() },
                    None => Target::Item { file: found.file, name: first.clone() },
                    Some(target) => target,
                };
            }
            (owner, rest, is_relative) = (child, others, false);
        }
        owner.map_or(Target::Elsewhere, |found| Target::Module(found.path.clone()))
    }

    /// A name that is no child of the module: an item, an import, or one of those that come by `*`.
    fn resolve_name(&self, module: &Module, name: &str, others: &[String], reexports: usize) -> Option<Target> {
        if module.items.contains(name) {
            return Some(Target::Item { file: module.file, name: name.to_owned() });
        }
        let reexports = reexports.checked_sub(1)?;
        if let Some(import) = module.imports.iter().find(|i| i.name == name && i.name != "*") {
            let path: Vec<String> = import.path.iter().chain(others).cloned().collect();
            return Some(self.resolve_within(module, &path, reexports));
        }
        if name == "*" {
            return None;
        }
        module.imports.iter().filter(|i| i.name == "*").find_map(|import| {
            let Target::Module(path) = self.resolve_within(module, &import.path[..import.path.len() - 1], reexports)
            else {
                return None;
            };
            if path == module.path { None } else { self.resolve_name(self.find(&path)?, name, others, reexports) }
        })
    }
}

/// The module of a file below `src/`; none for files that hold tests by their name.
fn module_path(file: &str) -> Option<Vec<String>> {
    let stem = file.strip_suffix(".rs")?;
    if stem.ends_with("_tests") || stem.ends_with("/tests") || stem == "tests" {
        return None;
    }
    let mut path: Vec<String> = stem.split('/').map(str::to_owned).collect();
    let is_root = matches!(path[..], [ref only] if only == "lib" || only == "main");
    if is_root || path.last().is_some_and(|last| last == "mod") {
        path.pop();
    }
    Some(path)
}

/// Words, `::` as one token, and single characters; lifetimes are left out.
fn tokens(code: &str) -> Vec<String> {
    let chars: Vec<char> = code.chars().collect();
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut tokens = Vec::new();
    let mut i = 0;
    while i < chars.len() {
        let length = chars[i..].iter().take_while(|&&c| is_word(c)).count();
        if length > 0 {
            tokens.push(chars[i..i + length].iter().collect());
            i += length;
        } else if chars[i] == '\'' {
            i += 1 + chars[i + 1..].iter().take_while(|&&c| is_word(c)).count();
        } else if chars[i..].starts_with(&[':', ':']) {
            tokens.push("::".to_owned());
            i += 2;
        } else {
            if !chars[i].is_whitespace() {
                tokens.push(chars[i].to_string());
            }
            i += 1;
        }
    }
    tokens
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

fn starts_with(tokens: &[String], expected: &[&str]) -> bool {
    tokens.len() >= expected.len() && tokens.iter().zip(expected).all(|(t, e)| t == e)
}

/// `use a::{self}` imports `a`.
fn without_self(mut path: Vec<String>) -> Vec<String> {
    if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
        path.pop();
    }
    path
}

/// Goes through the tokens of one file.
struct Reader<'a> {
    file: usize,
    tokens: &'a [String],
    at: usize,
    modules: &'a mut Vec<Module>,
    /// Modules in other files that are declared for tests alone.
    tests_only: &'a mut Vec<Vec<String>>,
}

impl Reader<'_> {
    fn token(&self, ahead: usize) -> &str {
        self.tokens.get(self.at + ahead).map_or("", String::as_str)
    }

    fn left(&self) -> &[String] {
        self.tokens.get(self.at..).unwrap_or_default()
    }

    /// Reads up to the end of the file, or to the brace that closes the module.
    fn module(&mut self, path: Vec<String>) {
        let mut module = Module { path, file: self.file, ..Module::default() };
        let mut depth = 0_usize;
        while self.at < self.tokens.len() {
            let token = self.token(0).to_owned();
            match token.as_str() {
                "}" if depth == 0 => break,
                "{" => depth += 1,
                "}" => depth -= 1,
                "#" if self.is_for_tests() => {
                    self.skip_item(&module.path);
                    continue;
                }
                "use" => {
                    let before = self.at.checked_sub(1).map_or("", |i| self.tokens[i].as_str());
                    self.at += 1;
                    let mut leaves = Vec::new();
                    self.import(Vec::new(), &mut leaves);
                    let is_reexport = matches!(before, "pub" | ")");
                    module.imports.extend(leaves.into_iter().map(|(path, name)| Import { path, name, is_reexport }));
                    continue;
                }
                "mod" if self.token(2) == "{" => {
                    let name = self.token(1).to_owned();
                    self.at += 3;
                    self.module(module.path.iter().cloned().chain([name]).collect());
                }
                "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static" | "union" if depth == 0 => {
                    module.items.insert(self.token(1).to_owned());
                }
                "macro_rules" => {
                    module.items.insert(self.token(2).to_owned());
                }
                "::" => {}
                word if is_name(word) => {
                    let path = self.path();
                    module.words.extend(path.first().cloned());
                    if path.len() > 1 {
                        module.paths.push(path);
                    }
                    continue;
                }
                _ => {}
            }
            self.at += 1;
        }
        self.modules.push(module);
    }

    /// Names with `::` between them.
    fn path(&mut self) -> Vec<String> {
        let mut path = vec![self.token(0).to_owned()];
        self.at += 1;
        while self.token(0) == "::" && is_name(self.token(1)) {
            path.push(self.token(1).to_owned());
            self.at += 2;
        }
        path
    }

    /// Reads what follows `use`, up to a comma, a brace or the semicolon; adds the path and the name of each leaf.
    fn import(&mut self, before: Vec<String>, leaves: &mut Vec<(Vec<String>, String)>) {
        let mut path = before;
        while self.at < self.tokens.len() {
            match self.token(0) {
                "::" => self.at += 1,
                "{" => {
                    self.at += 1;
                    while !matches!(self.token(0), "}" | "") {
                        self.import(path.clone(), leaves);
                        if self.token(0) == "," {
                            self.at += 1;
                        }
                    }
                    self.at += 1;
                    return;
                }
                "as" => {
                    let name = self.token(1).to_owned();
                    self.at += 2;
                    leaves.push((without_self(path), name));
                    return;
                }
                name if is_name(name) || name == "*" => {
                    path.push(name.to_owned());
                    self.at += 1;
                }
                _ => break,
            }
        }
        let path = without_self(path);
        if let Some(name) = path.last().cloned() {
            leaves.push((path, name));
        }
    }

    /// Is here an attribute that leaves its item out of builds without tests?
    fn is_for_tests(&self) -> bool {
        let conditions: [&[&str]; 2] =
            [&["#", "[", "cfg", "(", "test", ")", "]"], &["#", "[", "cfg", "(", "all", "(", "test"]];
        conditions.iter().any(|condition| starts_with(self.left(), condition))
    }

    /// Skips attributes and the item behind them.
    fn skip_item(&mut self, parent: &[String]) {
        while self.token(0) == "#" {
            self.skip_group("[", "]");
        }
        let mut words = self.left().iter();
        if let Some(at) = words.position(|t| t == "mod" || t == ";" || t == "{")
            && starts_with(&self.left()[at..], &["mod"])
        {
            let name = self.token(at + 1).to_owned();
            if self.token(at + 2) == ";" {
                self.tests_only.push(parent.iter().cloned().chain([name]).collect());
            }
        }
        while self.at < self.tokens.len() {
            match self.token(0) {
                "(" => self.skip_group("(", ")"),
                "[" => self.skip_group("[", "]"),
                "{" => {
                    let is_import = self.at > 0 && self.tokens[self.at - 1] == "::";
                    self.skip_group("{", "}");
                    if !is_import {
                        return;
                    }
                }
                // The end of a list of fields, variants or arms: the item had no end of its own.
                "}" => return,
                ";" | "," => {
                    self.at += 1;
                    return;
                }
                _ => self.at += 1,
            }
        }
    }

    /// Skips to behind the bracket that closes the next one.
    fn skip_group(&mut self, open: &str, close: &str) {
        let mut depth = 0_usize;
        while self.at < self.tokens.len() {
            let token = self.token(0);
            let is_open = token == open;
            let is_close = token == close;
            self.at += 1;
            if is_open {
                depth += 1;
            } else if is_close {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    return;
                }
            }
        }
    }
}
