//! (module of the workspace; see ARCHITECTURE.md)
