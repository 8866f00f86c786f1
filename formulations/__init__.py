"""The pages: equations only, CasADi only."""
