//! The table of files that a sample passes, in ARCHITECTURE.md.

/// The section of the table.
const HEADING: &str = "## The way of a sample";

/// Files that the table may have; a reader opens all of them.
const MAX_ROWS: usize = 10;

/// Checks the first table `| step | file | ... |` below the heading: its length, and that each row names a file that exists.
pub(crate) fn check(page: &str, is_file: impl Fn(&str) -> bool) -> Vec<String> {
    let mut lines = page.lines();
    if !lines.any(|line| line.trim_end() == HEADING) {
        return vec![format!("ARCHITECTURE.md: there is no section `{HEADING}`")];
    }
    let section = lines.take_while(|line| !line.starts_with("## "));
    let mut table =
        section.map(cells).skip_while(|c| c.get(..2) != Some(&["step", "file"])).take_while(|c| c.len() > 1);
    if table.next().is_none() {
        return vec![format!("ARCHITECTURE.md: `{HEADING}` has no table `| step | file | ... |`")];
    }
    let rows: Vec<Vec<&str>> = table.filter(|row| !row.iter().all(|cell| is_rule(cell))).collect();
    let mut faults = Vec::new();
    if rows.is_empty() || rows.len() > MAX_ROWS {
        faults.push(format!("ARCHITECTURE.md: `{HEADING}`: {} rows; 1 to {MAX_ROWS} are allowed", rows.len()));
    }
    for row in rows {
        let path = row[1].strip_prefix('`').and_then(|path| path.strip_suffix('`'));
        if !path.is_some_and(&is_file) {
            faults.push(format!("ARCHITECTURE.md: `{HEADING}`: step {}: {} is no file", row[0], row[1]));
        }
    }
    faults
}

/// The cells of a line of a table; at most one for other lines.
fn cells(line: &str) -> Vec<&str> {
    let inside = line.trim().strip_prefix('|').map(|l| l.strip_suffix('|').unwrap_or(l));
    inside.map_or_else(Vec::new, |inside| inside.split('|').map(str::trim).collect())
}

/// Is the cell part of the line below the head of a table?
fn is_rule(cell: &str) -> bool {
    !cell.is_empty() && cell.chars().all(|c| "-:".contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(rows: &str) -> Vec<String> {
        let page = format!(
            "# A\n| step | file |\n|---|---|\n| 1 | `elsewhere.rs` |\n\n## The way of a sample\n\nText.\n\n\
             | step | file | work |\n|---:|:---|---|\n{rows}\n| 1 | `another/table.rs` | x |\n\n## Next\n| 1 | `b.rs` | x |\n"
        );
        check(&page, |path| ["a.rs", "b/mod.rs"].contains(&path))
    }

    #[test]
    fn ten_rows_with_files_are_allowed() {
        assert_eq!(faults("| 1 | `a.rs` | x |\n| 2 | `b/mod.rs` | y |\n"), Vec::<String>::new());
        assert_eq!(faults(&"| 1 | `a.rs` | x |\n".repeat(10)), Vec::<String>::new());
    }

    #[test]
    fn more_rows_no_rows_and_missing_files_are_faults() {
        assert!(faults(&"| 1 | `a.rs` | x |\n".repeat(11))[0].contains("11 rows; 1 to 10"));
        assert!(faults("")[0].contains("0 rows"));
        let missing = faults("| 1 | `a.rs` | x |\n| 2 | `gone.rs` | y |\n| 3 | a.rs | z |\n");
        assert_eq!(missing.len(), 2);
        assert!(missing[0].ends_with("step 2: `gone.rs` is no file") && missing[1].contains("step 3"), "{missing:?}");
    }

    #[test]
    fn the_section_and_its_table_must_be_there() {
        assert!(check("# A\n", |_| true)[0].contains("no section"));
        assert!(check("## The way of a sample\nText.\n## B\n| step | file |\n", |_| true)[0].contains("no table"));
    }
}
