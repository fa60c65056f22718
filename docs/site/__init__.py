"""The documentation as a site: the pages of docs/ with a tree, a search and a tutorial that the tests run."""
