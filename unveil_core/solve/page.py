"""placeholder"""
def solve_page(model, reels, points, facts): return "<html></html>"
